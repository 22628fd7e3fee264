"""The solver for the CPU: one cluster of sources a thread, one source a SIMD lane."""
