"""Numerical tools without physics: arrays, block angular matrices, compilation, caches of a size, numbers in words."""
