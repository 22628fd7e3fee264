"""The solver for CUDA: one thread block a cluster of sources."""
