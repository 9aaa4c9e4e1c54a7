"""Simulated runs: one run of either engine, synthetic datasets, and the engines against each other."""

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
