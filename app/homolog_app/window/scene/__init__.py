"""The 3-D views. All of VTK is in here and lives in the window's thread; import it late, it is heavy."""
