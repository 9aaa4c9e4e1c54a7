"""Coefficients of the synthetic fish, off those that the checks simulate with."""

from pike_coefficients import COEFFICIENTS

TRUTH = dict(zip(COEFFICIENTS, (0.5, 0.6, 0.4, 1.5, 1.2, 1.6, 0.01, 0.008, 0.012), strict=True))
