"""Reading and writing: meshes, particles, tables, project folders."""
