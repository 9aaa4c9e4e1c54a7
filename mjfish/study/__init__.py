"""Studies: many pieces of work, such as datasets, settings and seeds, that can be stopped, divided and gone on with."""

from mjfish.study.cases import Case, Collected, Study, collect, read_cases, read_study
from mjfish.study.pieces import Piece, Shard, Store
from mjfish.study.run import Executing, Ran, run

__all__ = [
    "Case",
    "Collected",
    "Executing",
    "Piece",
    "Ran",
    "Shard",
    "Store",
    "Study",
    "collect",
    "read_cases",
    "read_study",
    "run",
]
