"""Kernel functions of both solvers: local solver, second order, memory access, lookup, mesh preparation."""
