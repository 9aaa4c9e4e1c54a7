"""Anyone's simulated swimming against measured swimming: files in, the same numbers for all out."""

from mjfish.comparison.comparison import Comparison, Shift, TrialComparison, compare

__all__ = ["Comparison", "Shift", "TrialComparison", "compare"]
