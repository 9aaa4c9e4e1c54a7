"""Table IV of [Yu2016]: which of its ranges the paper's model gives, and why not the others."""

from mjfish.compare.paper.result import PaperComparison
from mjfish.compare.paper.study import compare_paper

__all__ = ["PaperComparison", "compare_paper"]
