"""The Python API for shapes in memory: meshes and label maps in, arrays out."""
