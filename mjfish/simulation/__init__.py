"""Simulated runs: one run of either engine, synthetic datasets, and the engines against each other."""

from mjfish.simulation.band import Band
from mjfish.simulation.cross_check import BOUND, CASES, ENGINES, Case, CrossCheck, Level, Row, check, check_all, cpg_of
from mjfish.simulation.run import Simulation, parse_wave, simulate
from mjfish.simulation.synthetic import generate

__all__ = [
    "BOUND",
    "CASES",
    "ENGINES",
    "Band",
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
