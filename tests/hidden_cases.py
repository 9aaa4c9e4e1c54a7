"""Datasets with a hidden effect, everything in them drawn from a logged seed.

`MJFISH_SEED` draws anew: the tests must hold for any seed, up to the error rates that they state.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pike_coefficients import COEFFICIENTS

from mjfish.data import Dataset
from mjfish.drive.modes import MODES
from mjfish.effects import find
from mjfish.fish import load_fish
from mjfish.simulation.synthetic import generate

SEED = int(os.environ.get("MJFISH_SEED", "20261121"))
#: Long enough for a change of the mode at 5.2 s to show.
DURATION = 7.2
#: Sizes in units of a strong effect.
STRENGTHS = {"strong": 1.0, "middling": 0.4, "weak": 0.15}

#: Sigma of surge, sway [m/s] and yaw rate [rad/s], to half as much more or less.
NOISE = np.array([0.01, 0.01, 0.05])

Draw = Callable[[np.random.Generator], dict[str, float]]


def _current(rng: np.random.Generator) -> dict[str, float]:
    heading = rng.uniform(0.0, 2.0 * np.pi)
    return {"x": 0.06 * np.cos(heading), "y": 0.06 * np.sin(heading)}


def _shear(rng: np.random.Generator) -> dict[str, float]:
    shear_x, shear_y = rng.choice([-1.0, 1.0], size=2) * rng.uniform(0.08, 0.16, size=2)
    return {**_current(rng), "shear_x": shear_x, "shear_y": shear_y}


def _one(short: str, low: float, high: float, *, signed: bool = False) -> Draw:
    """Draw one amplitude, of either sign where `signed`."""
    return lambda rng: {short: rng.uniform(low, high) * (rng.choice([-1.0, 1.0]) if signed else 1.0)}


def _zero(rng: np.random.Generator) -> dict[str, float]:
    return {f"joint_{i}": float(rng.choice([-1.0, 1.0]) * rng.uniform(0.02, 0.06)) for i in range(1, 5)}


#: A strong effect of each kind.
STRONG: dict[str, Draw] = {
    "time_offset": _one("offset", 0.02, 0.04, signed=True),
    "clock_rate": _one("error", 0.002, 0.004, signed=True),
    "trim_moment": _one("square", 0.02, 0.04, signed=True),
    "servo_lag": _one("time_constant", 0.03, 0.05),
    "ambient_current": _current,
    "reynolds_drag": lambda rng: {"friction": rng.uniform(1.5, 3.0), "pressure": rng.uniform(0.5, 1.5)},
    "tail_compliance": _one("compliance", 0.1, 0.4),
    "munk_moment": _one("kappa", 0.6, 1.2, signed=False),
    "velocity_scale": _one("error", 0.15, 0.25, signed=True),
    "frame_misalignment": _one("angle", 0.05, 0.1, signed=True),
    "marker_offset": lambda rng: {"along": -rng.uniform(0.02, 0.04), "across": rng.uniform(-0.02, 0.02)},
    "servo_rate_limit": _one("slowness", 0.3, 0.45),
    "servo_saturation": _one("psi", 1.0, 3.0),
    "servo_backlash": lambda rng: dict.fromkeys([f"joint_{i}" for i in range(1, 5)], rng.uniform(0.04, 0.08)),
    "joint_zero_offset": _zero,
    "inertia_error": _one("error", 0.6, 1.2),
    "com_offset": _one("shift", 0.02, 0.04, signed=True),
    "linear_drag": lambda rng: {"along": rng.uniform(2.0, 5.0), "across": rng.uniform(60.0, 150.0)},
    "fin_lift": _one("slope", 2.0, 4.0),
    "roll": _one("height", 0.015, 0.03, signed=True),
    "wake_memory": _one("share", 0.3, 0.6),
    "power_drag": lambda rng: {"friction": rng.uniform(0.4, 0.8), "pressure": rng.uniform(0.4, 0.8)},
    "whole_speed_drag": lambda rng: {"friction": rng.uniform(0.6, 1.2), "pressure": rng.uniform(0.6, 1.2)},
    "exponential_drag": lambda rng: {"friction": rng.uniform(3.0, 6.0), "pressure": rng.uniform(2.0, 4.0)},
    "stream_lift": _one("slope", 2.0, 4.0),
    "body_lift": _one("slope", 1.0, 2.0),
    "axial_momentum": _one("share", 0.8, 1.5),
    "edge_momentum": _one("share", 0.5, 1.0),
    "added_mass_memory": _one("share", 0.6, 1.2),
    "servo_second_order": _one("time", 0.02, 0.04),
    "servo_delay": _one("time", 0.02, 0.04),
    "servo_limited_lag": _one("slowness", 0.3, 0.45),
    "tail_hardening": _one("compliance", 0.2, 0.5),
    "roll_loss": _one("square", 3.0, 8.0),
    "keulegan_carpenter_drag": _one("power", 0.4, 0.8),
    "sheared_current": _shear,
    "added_mass_amplitude": _one("loss", 0.4, 0.7),
}
#: Those that need the place of each run: it begins anywhere within this distance of the origin [m], in any heading.
PLACED = {"sheared_current": 0.8}
#: Shapes, which a strength does not scale.
SHAPES: dict[str, Draw] = {
    "tail_compliance": _one("damping", 0.005, 0.08),
    "wake_memory": _one("time", 0.08, 0.3),
    "roll": lambda rng: {"frequency": rng.uniform(5.0, 15.0), "damping": rng.uniform(0.1, 0.5)},
    "roll_loss": lambda rng: {"frequency": rng.uniform(5.0, 15.0), "damping": rng.uniform(0.1, 0.5)},
    "exponential_drag": _one("reynolds", 15.0, 60.0),
    "added_mass_memory": _one("time", 0.08, 0.3),
    "servo_second_order": _one("damping", 0.4, 1.0),
    "servo_limited_lag": _one("time", 0.003, 0.01),
    "tail_hardening": lambda rng: {"damping": rng.uniform(0.005, 0.08), "hardening": rng.uniform(20.0, 100.0)},
    "added_mass_amplitude": _one("half", 2.0, 6.0),
}


@dataclass(frozen=True)
class Case:
    """A synthetic dataset and its truth, by full parameter name."""

    dataset: Dataset
    effect: str | None
    truth: dict[str, float]


def coefficients(rng: np.random.Generator) -> dict[str, float]:
    """Draw coefficients well inside the paper's bounds."""
    ranges = {"c_m": (0.05, 1.5), "c_d": (0.3, 3.5), "c_f": (0.002, 0.018)}
    drawn = {}
    for name in COEFFICIENTS:
        low, high = ranges[name[:3]]
        drawn[name] = float(np.exp(rng.uniform(np.log(low), np.log(high))))
    return drawn


def _places(key: list[int], reach: float, trials: int) -> list[list[float]]:
    """Draw x, y [m] and yaw [rad] where each trial begins, apart from the other draws of a case."""
    rng = np.random.default_rng([*key, 1])
    return [[*rng.uniform(-reach, reach, size=2), rng.uniform(-np.pi, np.pi)] for _ in range(trials)]


def draw(effect: str | None, strength: str, number: int = 0, trials: int = 5, *, hide: bool = True) -> Case:
    """Draw coefficients, size of the effect, modes, noise; two trials are held out.

    Unless `hide`, the effect is left out of the data, and nothing else is changed.
    """
    key = [SEED, number, 0 if effect is None else 1 + list(STRONG).index(effect), list(STRENGTHS).index(strength)]
    rng = np.random.default_rng(key)
    truth = coefficients(rng)
    if effect is not None:
        for short, value in STRONG[effect](rng).items():
            truth[f"{effect}.{short}"] = float(STRENGTHS[strength] * value)
        for short, value in SHAPES.get(effect, lambda _: {})(rng).items():
            truth[f"{effect}.{short}"] = float(value)
    modes = list(rng.choice(MODES, size=trials, replace=False))
    dataset = generate(
        load_fish("pike"),
        modes,
        values={name: value for name, value in truth.items() if hide or name in COEFFICIENTS},
        effects=[find(effect)] if effect is not None and hide else [],
        noise=NOISE * rng.uniform(0.5, 1.5),
        duration=DURATION,
        seed=int(rng.integers(2**32)),
        held_out=modes[-2:],
        name=f"{effect or 'null'}, {strength}, seed {SEED}",
        places=_places(key, PLACED[effect], trials) if effect in PLACED else (),
    )
    return Case(dataset, effect, truth)


def trace(effect: str, strength: str, number: int) -> float:
    """Return the sum of squares that the hidden effect adds to the fitted trials, in units of the noise."""
    with_it, without = (draw(effect, strength, number, hide=hide).dataset.split()[0] for hide in (True, False))
    apart = np.concatenate([a.velocity - b.velocity for a, b in zip(with_it, without, strict=True)])
    return float(np.sum((apart / NOISE) ** 2))
