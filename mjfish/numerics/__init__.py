"""Numerical tools without physics: arrays, block angular matrices, compilation, caches limited by memory."""
