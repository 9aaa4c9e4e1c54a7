"""Scores of films whose joints were measured with much noise: the noise that a derivative shares with a residual."""

from __future__ import annotations

import numpy as np
import pytest

import mjfish
from mjfish.diagnosis.evidence import gather
from mjfish.effects import catalogue
from mjfish.estimation import Noise, Problem, fit
from mjfish.estimation.sensor_noise import with_sensor_noise
from mjfish.model import Model


def _explained(seed: int) -> float:
    """Return what all candidates explain of a film with nothing hidden, in units of their number."""
    runs = ["v1", "v3-t1", "v3-t2", "v5", "v5-v1"]
    pool = mjfish.generate(
        "pike", runs, observe="pose", joints="measured", joint_noise=np.deg2rad(1.0), noise=(3e-4, 3e-4, 1.75e-3),
        duration=8.0, seed=seed,
    )  # fmt: skip
    posed = Problem(Model(pool.fish), pool.split()[0], Noise.white(np.ones(3)))
    x = posed.start(posed.model.values())
    for _ in range(2):
        posed = with_sensor_noise(posed, x)
        found = fit(posed, x, tolerance=1e-6)
        x = found.x
    causes = [effect for effect in catalogue().values() if not effect.learned and not effect.not_applicable(pool)]
    statistic, rank = gather(posed, found, causes).saturated()
    return statistic / rank


@pytest.mark.slow
def test_noise_of_joints_is_no_cause(monkeypatch: pytest.MonkeyPatch) -> None:
    """Along noisy joints the scores are 1.6 and 1.9 (p = 0.008, 0.0005), along the best guess 1.1 and 1.4."""
    best = [_explained(seed) for seed in (1, 2)]
    monkeypatch.setattr(Problem, "smoother", property(lambda itself: itself))
    noisy = [_explained(seed) for seed in (1, 2)]
    assert np.mean(best) < 1.35
    assert np.mean(noisy) > 1.5
