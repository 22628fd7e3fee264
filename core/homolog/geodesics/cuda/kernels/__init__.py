"""Kernels of the CUDA solver; on a CPU they run with a block of one thread."""
