"""Truncated all-pairs geodesic distances on triangle meshes."""
