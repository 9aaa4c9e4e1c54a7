"""Anyone's simulated swimming against measured swimming: files in, the same numbers for all out."""

from mjfish.compare.comparison import Comparison, TrialComparison, compare
from mjfish.compare.shift import Shift

__all__ = ["Comparison", "Shift", "TrialComparison", "compare"]
