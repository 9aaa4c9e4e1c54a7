"""Drag that comes late."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from pike_coefficients import COEFFICIENTS

from mjfish.data import Trial
from mjfish.effects.wake_memory import WakeMemory
from mjfish.fish import Fish
from mjfish.hydro.force import drag
from mjfish.hydro.link import link_records
from mjfish.hydro.load import ANSWER, LoadBuffers, load_rows, loads_on
from mjfish.model import Model
from mjfish.model.sensitivity import sensitivities

VALUES = dict(zip(COEFFICIENTS, (1.0, 0.5, 0.6, 2.0, 1.5, 2.5, 0.02, 0.01, 0.02), strict=True))


def _call(pike: Fish, remembered: tuple[float, float]) -> tuple[np.ndarray, np.ndarray, tuple[float, float, float]]:
    """Return force and rates of share 0.4, time 0.2 on the third link, and its drag."""
    records = link_records(pike, VALUES)
    records[2]["u"], records[2]["v"], records[2]["w"] = 0.3, 0.2, -5.0
    assert WakeMemory.load is not None
    state, rates = np.zeros(10), np.zeros(10)
    state[4:6] = remembered
    table = load_rows([(WakeMemory.load, (0.4, 0.2))], 5)
    pushed = loads_on(records, 2, 2, table, False, LoadBuffers(np.zeros(ANSWER), state, rates))
    return np.array(pushed), rates, drag(records[2])


def test_a_share_of_the_drag_is_replaced_by_what_is_remembered_of_it(pike: Fish) -> None:
    """The sign of the lag, the link whose memory it is, friction left alone."""
    pushed, rates, (_, force, moment) = _call(pike, (0.02, -0.001))
    np.testing.assert_allclose(pushed, [0.0, 0.4 * (0.02 - force), 0.4 * (-0.001 - moment)], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(rates[4:6], [(force - 0.02) / 0.2, (moment + 0.001) / 0.2], rtol=1e-12)
    assert not rates[:4].any()
    assert not rates[6:].any()


def test_a_drag_that_is_remembered_right_is_the_drag(pike: Fish) -> None:
    _, _, (_, force, moment) = _call(pike, (0.0, 0.0))
    pushed, rates, _ = _call(pike, (force, moment))
    np.testing.assert_allclose(np.concatenate([pushed, rates]), 0.0, atol=1e-14)


def test_a_lag_far_shorter_than_a_beat_is_none(pike: Fish, straight: Trial) -> None:
    """F_lag - F is about -tau F': halving tau halves what the wake does."""
    model = Model(pike, (WakeMemory(),), step=0.002)
    nominal = Model(pike, step=0.002).predict(straight, VALUES).velocity

    def apart(time: float) -> float:
        values = VALUES | {"wake_memory.share": 0.5, "wake_memory.time": time}
        return float(np.abs(model.predict(straight, values).velocity - nominal).max())

    assert 1.6 < apart(0.02) / apart(0.01) < 2.4


def test_its_derivatives_at_null_and_off_it(pike: Fish, turning: Trial) -> None:
    """At null the wake goes along unfelt; time is a shape, without effect there."""
    model = Model(pike, (WakeMemory(),))
    trial = replace(turning, pose=np.zeros((len(turning.time), 3)))

    def at(share: float, time: float) -> np.ndarray:
        values = VALUES | {"wake_memory.share": share, "wake_memory.time": time}
        return model.predict(trial, values).velocity

    for share in (0.0, 0.4):
        values = VALUES | {"wake_memory.share": share, "wake_memory.time": 0.1}
        found = sensitivities(model, trial, values, ["c_d.tail", "wake_memory.share", "wake_memory.time"])
        h = 1e-3
        by_share = (
            8.0 * (at(share + h, 0.1) - at(share - h, 0.1)) - at(share + 2 * h, 0.1) + at(share - 2 * h, 0.1)
        ) / (12.0 * h)
        by_time = (at(share, 0.1 + h) - at(share, 0.1 - h)) / (2.0 * h)
        np.testing.assert_allclose(found[:, :, 1], by_share, rtol=0.0, atol=1e-7 * np.abs(by_share).max())
        np.testing.assert_allclose(found[:, :, 2], by_time, rtol=0.0, atol=2e-3 * np.abs(by_time).max())
        assert np.abs(found[:, :, 2]).max() == 0.0 or share > 0.0
