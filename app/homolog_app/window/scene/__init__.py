"""The 3-D views. Everything of VTK is in here and lives in the window's thread; import it late, it is heavy."""
