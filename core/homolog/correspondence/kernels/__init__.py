"""Warp kernels of the optimizer: projection and closest points, the step, sampling forces, the dual."""
