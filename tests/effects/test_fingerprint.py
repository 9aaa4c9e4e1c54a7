"""Fingerprints that causes declare, measured on steady straight swimming."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from pike_coefficients import COEFFICIENTS

from mjfish.data import Dataset, Trial
from mjfish.drive import cpg
from mjfish.drive.cpg import DriveSegment
from mjfish.effects import Effect, catalogue
from mjfish.fish import Fish, load_fish
from mjfish.model import Model
from mjfish.model.sensitivity import sensitivities
from mjfish.numerics.arrays import FloatArray, readonly

#: Frequencies of the drive that are compared [rad/s].
OMEGA = (16.0, 26.0)
#: Samples in a beat, an even number, and beats that are looked at, after the fish has got up to speed.
SAMPLES, BEATS, START = 48, 4, 9.0
#: Glide reflection of surge, sway, yaw rate: half a beat later the same, mirrored.
MIRROR = np.array([1.0, -1.0, -1.0])
EFFECTS = catalogue()


def _steady(fish: Fish, omega: float) -> Trial:
    """Return a trial sampled an even number of times in each of its last beats."""
    drive = (DriveSegment(0.0, omega, (0.0, 0.0, 0.0, 0.0)),)
    motion = cpg.joint_motion(fish.cpg, drive, START + 3.0, 0.005)
    time, angle = motion.time[:-1], motion.angle[:, 0, 0]
    up = np.flatnonzero((angle[:-1] < 0.0) & (angle[1:] >= 0.0) & (time[1:] > START))
    crossings = time[up] - angle[up] * (time[up + 1] - time[up]) / (angle[up + 1] - angle[up])
    beat = float(np.mean(np.diff(crossings)))
    sampled = START + beat / SAMPLES * np.arange(-int(START / beat) * SAMPLES, BEATS * SAMPLES)
    zero = readonly(np.zeros((len(sampled), 3)))
    return Trial(f"omega {omega:g}", None, readonly(sampled), zero, drive)


def _discrepancy(fish: Fish, effect: Effect, trial: Trial, size: float) -> FloatArray:
    """Return the change (n, 3) that all amplitudes make together, divided by the frequency."""
    model = Model(fish, (effect,))
    sizes = {p.name: p.default if p.shape else p.default + size * p.scale for p in effect.parameters}
    with_it = model.predict(trial, model.values(sizes)).velocity
    return np.asarray(with_it - _nominal(trial))[-BEATS * SAMPLES :] / trial.drive[0].omega


@functools.cache
def _nominal(trial: Trial) -> FloatArray:
    """Return what the pike does without any cause, predicted once."""
    model = Model(load_fish("pike"))
    return model.predict(trial, model.values()).velocity


def _odd_share(change: FloatArray) -> float:
    """Return the share of the energy that the glide reflection does not keep."""
    half = SAMPLES // 2
    early, late = change[:-half], change[half:] * MIRROR
    odd, even = np.sum((early - late) ** 2), np.sum((early + late) ** 2)
    return float(odd / (odd + even))


@pytest.fixture(scope="module")
def steady(pike: Fish) -> tuple[Trial, ...]:
    """Straight swimming at either frequency."""
    return tuple(_steady(pike, omega) for omega in OMEGA)


def _with(declared: str) -> list[Effect]:
    return [effect for effect in EFFECTS.values() if getattr(effect.fingerprint, declared) is not None]


def _seen(effect: Effect, fish: Fish, trial: Trial) -> None:
    """Skip what a bare trial does not show."""
    said = effect.not_applicable(Dataset("d", fish, (trial,)))
    if said:
        pytest.skip(f"{effect.name}: {said}")


@pytest.mark.parametrize("effect", _with("odd"), ids=lambda effect: effect.name)
def test_a_cause_breaks_the_glide_reflection_or_keeps_it_as_it_declares(
    effect: Effect, pike: Fish, steady: tuple[Trial, ...]
) -> None:
    """More than 0.99 of the energy of the discrepancy is odd, or less than 0.01."""
    _seen(effect, pike, steady[0])
    shares = [_odd_share(_discrepancy(pike, effect, trial, 2.0)) for trial in steady]
    assert min(shares) > 0.99 if effect.fingerprint.odd else max(shares) < 0.01, shares


@pytest.mark.parametrize("effect", _with("exponent"), ids=lambda effect: effect.name)
def test_the_nondimensional_discrepancy_goes_with_the_frequency_as_the_cause_declares(
    effect: Effect, pike: Fish, steady: tuple[Trial, ...]
) -> None:
    """Within 0.35: the joints' pattern of a CPG changes a little with its frequency, and contact takes a time."""
    _seen(effect, pike, steady[0])
    sizes = [np.linalg.norm(_discrepancy(pike, effect, trial, 1.0)) for trial in steady]
    exponent = np.log(sizes[1] / sizes[0]) / np.log(OMEGA[1] / OMEGA[0])
    assert exponent == pytest.approx(effect.fingerprint.exponent, abs=0.35)


#: Of surge, sway, yaw rate against each other.
_WEIGHT = np.array([100.0, 100.0, 20.0])[:, None]
#: Away from the bounds, so that every coefficient hides what it can.
VALUES = dict(zip(COEFFICIENTS, (0.6, 0.4, 0.7, 1.5, 1.2, 2.0, 0.012, 0.008, 0.011), strict=True))


def _left(fish: Fish, effect: Effect, trials: tuple[Trial, ...]) -> float:
    """Return the share that the nine coefficients leave of the change that all amplitudes make together, steadily."""
    model = Model(fish, (effect,))
    amplitudes = [p for p in effect.parameters if not p.shape]
    names, values = [*COEFFICIENTS, *(p.name for p in amplitudes)], model.values(VALUES)
    rows = [sensitivities(model, trial, values, names)[-BEATS * SAMPLES :] * _WEIGHT for trial in trials]
    found = np.concatenate(rows).reshape(-1, len(names))
    nuisance, change = found[:, :9], found[:, 9:] @ [p.scale for p in amplitudes]
    left = change - nuisance @ np.linalg.lstsq(nuisance, change, rcond=None)[0]
    return float(np.linalg.norm(left) / np.linalg.norm(change))


@pytest.mark.parametrize(
    "effect",
    [effect for effect in EFFECTS.values() if effect.mechanism == "drag_law" and not effect.learned],
    ids=lambda effect: effect.name,
)
def test_a_drag_law_that_one_frequency_hides_says_so(effect: Effect, pike: Fish, steady: tuple[Trial, ...]) -> None:
    """Coefficients have the level of a law of the speed: of it, a second frequency leaves much more than the first.

    Of a law that goes with angle or amplitude they have all, or as much at one.
    """
    one, two = _left(pike, effect, (steady[1], steady[1])), _left(pike, effect, steady)
    more = two - 3.0 * one
    assert (more > 0.03) == effect.unclear_under("design-one-frequency"), (one, two)
    assert more > 0.03 or more < 0.01, (one, two)
