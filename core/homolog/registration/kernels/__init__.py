"""Warp kernels of poses."""
