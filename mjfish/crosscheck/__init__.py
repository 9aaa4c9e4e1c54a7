"""Cross-checks of the engines: against each other on a servo's motion, all of them on a prescribed one."""

from mjfish.crosscheck.engines import CASES, Case, Row, engines
from mjfish.crosscheck.realised import BOUND, CrossCheck, Level, check

__all__ = ["BOUND", "CASES", "Case", "CrossCheck", "Level", "Row", "check", "engines"]
