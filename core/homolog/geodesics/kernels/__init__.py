"""Kernel functions of both solvers: local solver, memory access, lookup, mesh preparation."""
