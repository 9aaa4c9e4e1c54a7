"""Anyone's simulated swimming against measured swimming: files in, the same numbers for all out."""

from mjfish.comparison.comparison import Comparison, TrialComparison, compare
from mjfish.comparison.shift import Shift

__all__ = ["Comparison", "Shift", "TrialComparison", "compare"]
