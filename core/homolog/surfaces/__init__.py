"""Segmentations, distance fields and triangle meshes."""
