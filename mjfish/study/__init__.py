"""Studies: many pieces of work, such as datasets, settings and seeds, that can be stopped, divided and gone on with."""

from mjfish.study.cases import Case, read_cases
from mjfish.study.collect import Collected, collect
from mjfish.study.pieces import Piece, Shard
from mjfish.study.run import Executing, Ran, run
from mjfish.study.store import Store
from mjfish.study.study_toml import Study, read_study

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
