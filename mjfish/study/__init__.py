"""Studies: many datasets, settings and seeds, a piece each, that can be stopped, divided and gone on with."""

from mjfish.study.collect import Collected, collect
from mjfish.study.pieces import Piece, Shard, pieces_of
from mjfish.study.run import Executing, Ran, run
from mjfish.study.study_toml import Study, read_study

__all__ = ["Collected", "Executing", "Piece", "Ran", "Shard", "Study", "collect", "pieces_of", "read_study", "run"]
