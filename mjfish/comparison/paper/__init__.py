"""Table IV of [Yu2016]: which of its ranges the paper's model gives, and why not the others."""

from mjfish.comparison.paper.result import PaperComparison
from mjfish.comparison.paper.study import compare_paper

__all__ = ["PaperComparison", "compare_paper"]
