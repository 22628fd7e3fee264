"""Solver for the CPU: each thread solves one cluster of sources at a time, each SIMD lane one source."""
