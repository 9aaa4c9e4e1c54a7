"""Cross-checks of the engines: against each other on a servo's motion, all of them on a prescribed one."""

from mjfish.simulation.engines import CASES, ENGINES, Case, Row, check_all
from mjfish.simulation.realised import BOUND, CrossCheck, Level, check, cpg_of
from mjfish.simulation.run import Simulation, parse_wave, simulate
from mjfish.simulation.synthetic import generate

__all__ = [
    "BOUND",
    "CASES",
    "ENGINES",
    "Case",
    "CrossCheck",
    "Level",
    "Row",
    "Simulation",
    "check",
    "check_all",
    "cpg_of",
    "generate",
    "parse_wave",
    "simulate",
]
