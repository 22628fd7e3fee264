"""Kernels of the CPU solver."""
