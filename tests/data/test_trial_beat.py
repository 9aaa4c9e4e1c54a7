"""The number of beats in measured joint angles."""

from __future__ import annotations

import numpy as np
import pytest

from mjfish.data import validation


def angles(turns: float, *, noise: float = 0.0, phase: float = 0.0, rows: int = 60) -> tuple[np.ndarray, np.ndarray]:
    time = np.linspace(3.0, 5.0, rows)
    turn = 2.0 * np.pi * turns * (time - 3.0) / 2.0
    angle = np.stack([0.2 + 0.1 * joint * np.cos(turn + phase - joint) for joint in range(5)], axis=1)
    return time, angle + noise * np.random.default_rng(1).standard_normal(angle.shape)


@pytest.mark.parametrize("phase", [0.0, 1.0, 2.0, 3.0, 4.0, 5.0])
@pytest.mark.parametrize("turns", [0.5, 0.8, 1.0, 1.3, 2.4])
def test_a_short_recording_has_the_beats_it_was_made_of(turns: float, phase: float) -> None:
    """Catches a periodogram: its lowest line is one turn, whatever fraction of a beat there was."""
    assert validation.count_beats(*angles(turns, phase=phase)) == pytest.approx(turns, abs=1e-9)
    assert validation.count_beats(*angles(turns, phase=phase, noise=0.005)) == pytest.approx(turns, abs=0.11)


@pytest.mark.parametrize("turns", [3.0, 7.0, 20.0])
def test_a_long_recording_has_the_beats_it_was_made_of_over_a_drift(turns: float) -> None:
    time, angle = angles(turns, noise=0.01)
    drift = np.linspace(-1.0, 1.0, len(time))[:, None]
    assert validation.count_beats(time, angle + drift) == turns


def test_still_joints_have_no_beat() -> None:
    assert validation.count_beats(np.linspace(0.0, 1.0, 20), np.full((20, 4), 0.3)) is None
