"""Servo dynamics of any form are told by how late the joints are at the beat: 40 ms, not 0.0119 s and 1.77."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from mjfish.diagnosis.evidence import gather
from mjfish.diagnosis.refit import refit_with
from mjfish.diagnosis.refit_result import Refit
from mjfish.diagnosis.servo_delay import servo_delays
from mjfish.effects import find
from mjfish.estimation import fit
from mjfish.estimation.nominal import nominal_problem
from mjfish.fish import load_fish
from mjfish.noise import Noise
from mjfish.simulation.synthetic import generate

SIGMA = np.array([0.006, 0.006, 0.04])


def _refit(values: Mapping[str, float]) -> Refit:
    """Return a refit with the cause that was planted in two runs, of a slow and of a fast beat."""
    (name,) = {full.partition(".")[0] for full in values}
    dataset = generate(load_fish("pike"), ["v1", "v5"], values=values, noise=SIGMA, duration=6.0, seed=2)
    problem = nominal_problem(dataset, dataset.trials, Noise.white(SIGMA))
    effect = find(name)
    return refit_with(gather(problem, fit(problem), [effect]), effect)


def _lag(omega: float, own: Mapping[str, float]) -> float:
    return float(np.arctan(omega * own["time_constant"]))


def _second_order(omega: float, own: Mapping[str, float]) -> float:
    time = omega * own["time"]
    return float(np.arctan2(2.0 * own["damping"] * time, 1.0 - time**2))


@pytest.mark.parametrize(
    ("values", "phase"),
    [
        ({"servo_lag.time_constant": 0.02}, _lag),
        ({"servo_second_order.time": 0.0119, "servo_second_order.damping": 1.77}, _second_order),
        ({"servo_delay.time": 0.03}, lambda omega, own: omega * own["time"]),
    ],
)
def test_the_delay_is_the_phase_of_the_transfer_function_over_the_frequency(values: Mapping[str, float], phase) -> None:  # type: ignore[no-untyped-def]
    refit = _refit(values)
    own = refit.effects[0].short_values(refit.fit.values)
    slow, fast = servo_delays(refit).items()
    assert float(slow[0].removesuffix(" Hz")) < float(fast[0].removesuffix(" Hz"))
    for beat, delay in (slow, fast):
        omega = 2.0 * np.pi * float(beat.removesuffix(" Hz"))
        assert delay.estimate == pytest.approx(1e3 * phase(omega, own) / omega, rel=0.02)
        assert delay.unit == "ms"
        assert 0.0 < delay.high - delay.estimate < 3.0
        assert delay.high - delay.estimate == pytest.approx(delay.estimate - delay.low)


def test_other_causes_have_no_delay() -> None:
    assert servo_delays(_refit({"time_offset.offset": 0.02})) == {}
