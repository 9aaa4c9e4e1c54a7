"""The model that is fitted: parameters, drive, prediction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pike_coefficients import COEFFICIENTS

from mjfish import ode
from mjfish.data import Trial
from mjfish.drive import cpg
from mjfish.drive.cpg import DriveSegment
from mjfish.effects import find
from mjfish.errors import InputError, ParameterError, UnknownNameError
from mjfish.fish import Fish
from mjfish.model import LEAD, Model, requested_motion
from mjfish.numerics.arrays import readonly

DRIVE = (DriveSegment(0.0, 18.0, (0.0,) * 4), DriveSegment(1.2, 22.0, (0.0, 1.0, 1.5, 2.0)))
TIME = np.arange(101) / 50.0


@pytest.fixture(scope="module")
def driven() -> Trial:
    return Trial("driven", None, readonly(TIME), readonly(np.zeros((101, 3))), DRIVE)


def _measured(fish: Fish, start: float, rate: float = 100.0) -> tuple[Trial, Trial]:
    """Return a fine CPG run, and its part from `start` on as if its joints had been measured."""
    time = np.arange(round(3.0 * rate) + 1) / rate
    whole = Trial("whole", None, readonly(time), readonly(np.zeros((len(time), 3))), DRIVE[:1])
    model = Model(fish, step=0.001)
    run = model.predict(whole, model.values())
    late = time >= start
    part = Trial(
        "part", None, readonly(time[late]), readonly(run.velocity[late]),
        joint_angle=readonly(run.rollout.motion.angle_at(time[late])),
    )  # fmt: skip
    return replace(whole, velocity=readonly(run.velocity)), part


def test_parameters_are_the_nine_coefficients_then_those_of_each_effect(pike: Fish) -> None:
    model = Model(pike).extended(find("servo_lag")).extended(find("ambient_current"))
    names = [p.name for p in model.parameters]
    current = [f"ambient_current.{short}" for short in ("x", "y", "held")]
    assert names == [*COEFFICIENTS, "servo_lag.time_constant", *current]


def test_values_are_complete_and_checked(pike: Fish) -> None:
    model = Model(pike, (find("munk_moment"),))
    values = model.values({"c_d.head": 2.0, "munk_moment.kappa": 0.5})
    assert values == {**pike.values, "c_d.head": 2.0, "munk_moment.kappa": 0.5}
    with pytest.raises(UnknownNameError, match=r"unknown parameter 'c_d.fin'; known: c_d.body, "):
        model.values({"c_d.fin": 1.0})
    with pytest.raises(ParameterError, match=r"munk_moment.kappa: value 7 - is outside its bounds \[-1, 2\]"):
        model.values({"munk_moment.kappa": 7.0})
    with pytest.raises(ParameterError, match=r"c_d.head: value nan"):
        model.values({"c_d.head": float("nan")})


def test_a_prediction_is_the_rollout_read_at_the_times_of_the_trial(pike: Fish, driven: Trial) -> None:
    values = {**pike.values, "c_d.tail": 1.1}
    motion = cpg.joint_motion(pike.cpg, DRIVE, 2.0 + LEAD, 0.005)
    rollout = ode.simulate(pike, motion, values=values)
    predicted = Model(pike).predict(driven, values)
    assert predicted.velocity.tobytes() == rollout.at(TIME)[:, :3].tobytes()
    assert (predicted.status, predicted.message) == ("ok", "")
    assert not np.any(predicted.velocity[0])


def test_predictions_converge_with_the_step_at_fourth_order(pike: Fish, driven: Trial) -> None:
    smooth = replace(driven, drive=DRIVE[:1])
    runs = [Model(pike, step=0.01 / 2**k).predict(smooth, pike.values).velocity for k in range(5)]
    errors = np.array([np.sqrt(np.mean((a - runs[-1]) ** 2)) for a in runs[:-1]])
    assert np.log2(errors[0] / errors[2]) / 2.0 == pytest.approx(4.0, abs=0.5)


def test_the_printed_gyroscopic_terms_swim_differently(pike: Fish, driven: Trial) -> None:
    printed, right = (Model(pike, coriolis=form).predict(driven, pike.values) for form in ("printed", "corrected"))
    assert np.max(np.abs(printed.velocity - right.velocity)) > 0.1


def test_values_outside_their_bounds_are_predicted_for_fits_step_over_them(pike: Fish, driven: Trial) -> None:
    beyond = Model(pike).predict(driven, {**pike.values, "c_d.head": 4.01})
    assert np.all(np.isfinite(beyond.velocity))


def test_the_spline_of_measured_angles_drives_the_fish_as_the_cpg_did(pike: Fish) -> None:
    """From the middle of a run on, given its velocity there. Catches a spline read at times from the wrong start."""
    whole, part = _measured(pike, 2.0)
    late = whole.time >= 2.0
    found = Model(pike).predict(part, pike.values, velocity=part.velocity[0])
    inside = slice(5, -5)
    error = np.abs(found.velocity - whole.velocity[late])[inside]
    assert np.all(error.max(axis=0) < 0.01 * np.ptp(part.velocity, axis=0))
    resting = Model(pike).predict(part, pike.values)
    assert np.abs(resting.velocity - whole.velocity[late]).max() > 0.1


def test_measured_motion_that_nobody_saw_is_not_made_up(pike: Fish) -> None:
    """Before the first angle and behind the last the state stands still."""
    _, part = _measured(pike, 2.0)
    early, late = (
        Model(pike).predict(part, pike.values, velocity=part.velocity[0], offset=offset) for offset in (-0.05, 0.05)
    )
    np.testing.assert_allclose(early.velocity[:5], np.broadcast_to(part.velocity[0], (5, 3)), rtol=1e-12)
    np.testing.assert_array_equal(late.velocity[-5:], np.broadcast_to(late.velocity[-1], (5, 3)))


def test_the_motion_of_a_trial_is_made_once(pike: Fish, driven: Trial) -> None:
    assert requested_motion(pike.cpg, driven, 0.005) is requested_motion(pike.cpg, driven, 0.005)
    assert requested_motion(pike.cpg, driven, 0.005) is not requested_motion(pike.cpg, driven, 0.0025)


def test_a_fish_without_cpg_cannot_follow_a_drive(pike: Fish, driven: Trial) -> None:
    bare = pike.model_copy(update={"cpg": None})
    with pytest.raises(InputError, match=r"trial 'driven' is driven by a CPG, but the fish has none; add \[cpg\]"):
        Model(bare).predict(driven, bare.values)


def test_a_run_that_diverges_is_a_status_with_time_and_parameters(pike: Fish, driven: Trial) -> None:
    lost = Model(pike).predict(driven, {**pike.values, "c_d.head": 1e6})
    assert lost.status == "diverged"
    assert np.all(np.isnan(lost.velocity[-1]))
    assert np.all(np.isfinite(lost.velocity[0]))
    assert lost.message.startswith("diverged at 0.")
    assert "c_d.head = 1e+06" in lost.message
