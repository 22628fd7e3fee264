"""The first particles: registration to a reference shape, then splitting."""
