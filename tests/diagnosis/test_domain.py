"""The domain of what no cause explains."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mjfish.diagnosis.evidence import gather
from mjfish.diagnosis.isolability import explaining_domain, sole_domain
from mjfish.effects import catalogue, of_fish
from mjfish.effects.mechanism import Domain
from mjfish.estimation import Fit, Noise, Problem, fit
from mjfish.fish import Fish
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


@pytest.fixture(scope="module")
def nominal(pike: Fish) -> tuple[Problem, Fit]:
    """Two runs of the nominal fish, fitted."""
    data = generate(pike, ["v1", "v3-t2"], noise=NOISE, duration=6.0, seed=5)
    problem = Problem(Model(pike), data.trials, Noise.white(NOISE))
    return problem, fit(problem)


@pytest.mark.parametrize("name", ["marker_offset", "joint_zero_offset", "lift", "roll_loss"])
def test_a_misfit_along_the_signatures_of_a_domain_is_of_that_domain(nominal: tuple[Problem, Fit], name: str) -> None:
    """A residual that one cause of the domain makes to first order, of a strength of 900."""
    effects = tuple(of_fish(catalogue(), nominal[0].model.fish).values())
    formulas = [effect for effect in effects if not effect.learned]
    learned = [effect for effect in effects if effect.learned]
    own = next(effect for effect in effects if effect.name == name)
    clear = gather(*nominal, formulas)
    misfit = gather(*nominal, [own]).signatures @ np.random.default_rng(2).standard_normal(len(own.amplitudes()))
    moved = replace(clear, cleared=clear.cleared + 30.0 * misfit / np.linalg.norm(misfit))
    assert explaining_domain(moved, learned) == own.domain


def test_noise_is_of_no_domain(nominal: tuple[Problem, Fit]) -> None:
    effects = tuple(of_fish(catalogue(), nominal[0].model.fish).values())
    clear = gather(*nominal, [effect for effect in effects if not effect.learned])
    assert explaining_domain(clear, [effect for effect in effects if effect.learned]) is None
