"""Table IV of [Yu2016]: which of its ranges the paper's model gives, and why not the others."""

from studies.table_iv.result import PaperComparison
from studies.table_iv.study import compare_paper

__all__ = ["PaperComparison", "compare_paper"]
