"""Kernels by numba: arrays and numbers in, arrays and numbers out."""
