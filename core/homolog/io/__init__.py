"""Files of others and ours: images, label maps, meshes, particles, tables, the project folder."""
