"""Compiled operations for CPUs, which PyTorch can do without."""
