"""Simulated runs: one run of either engine, synthetic datasets, and the engines against each other."""

from mjfish.simulation.cross_check import BOUND, CrossCheck, Level, check, cpg_of, loads_of_mode
from mjfish.simulation.run import Band, Simulation, parse_wave, simulate
from mjfish.simulation.synthetic import generate

__all__ = [
    "BOUND",
    "Band",
    "CrossCheck",
    "Level",
    "Simulation",
    "check",
    "cpg_of",
    "generate",
    "loads_of_mode",
    "parse_wave",
    "simulate",
]
