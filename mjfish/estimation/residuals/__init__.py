"""Residual analysis: is what a fit leaves white and independent of the input, and what did the fit take out."""
