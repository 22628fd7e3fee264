"""Solver for CUDA: each thread block solves one cluster of sources."""
