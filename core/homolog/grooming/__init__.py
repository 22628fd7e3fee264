"""From a file to an aligned distance field and mesh, per subject."""
