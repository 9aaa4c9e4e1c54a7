"""The domain of what no cause explains."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjfish.diagnosis.evidence import Evidence, gather
from mjfish.diagnosis.isolability import explaining_domain, sole_domain
from mjfish.effects import catalogue, of_fish
from mjfish.effects.mechanism import Domain
from mjfish.estimation import Noise, Problem, fit
from mjfish.fish import Fish, load_fish
from mjfish.model import Model
from mjfish.simulation.synthetic import generate

NOISE = np.array([0.006, 0.006, 0.04])


@pytest.mark.parametrize(
    ("shares", "expected"),
    [
        ({"data": 0.9, "drive": 0.05, "body": 0.6, "water": 0.5}, "drive"),
        ({"data": 0.9, "drive": 0.05, "body": 0.6, "water": 0.2}, None),
        ({"data": 0.9, "drive": 0.15, "body": 0.6, "water": 0.5}, None),
    ],
)
def test_a_domain_is_stated_where_it_alone_leaves_little(shares: dict[Domain, float], expected: str | None) -> None:
    assert sole_domain(shares) == expected


EFFECTS = tuple(of_fish(catalogue(), load_fish("pike")).values())
LEARNED = [effect for effect in EFFECTS if effect.learned]


@pytest.fixture(scope="module")
def clear(pike: Fish) -> Evidence:
    """Evidence of all formulas in two runs of the nominal fish."""
    data = generate(pike, ["v1", "v3-t2"], noise=NOISE, duration=6.0, seed=5)
    problem = Problem(Model(pike), data.trials, Noise.white(NOISE))
    return gather(problem, fit(problem), [effect for effect in EFFECTS if not effect.learned])


@pytest.mark.parametrize("name", ["marker_offset", "joint_zero_offset", "lift", "roll_loss"])
def test_a_misfit_along_the_signatures_of_a_domain_is_of_that_domain(clear: Evidence, name: str) -> None:
    """A residual that one cause of the domain makes to first order, of a strength of 900."""
    own = next(effect for effect in EFFECTS if effect.name == name)
    misfit = gather(clear.problem, clear.fit, [own]).signatures @ np.random.default_rng(2).standard_normal(
        len(own.amplitudes())
    )
    moved = replace(clear, cleared=clear.cleared + 30.0 * misfit / np.linalg.norm(misfit))
    assert explaining_domain(moved, LEARNED) == own.domain


def test_noise_is_of_no_domain(clear: Evidence) -> None:
    assert explaining_domain(clear, LEARNED) is None
