"""What whitens the sensors of runs whose joints were measured is linearised where the fish was."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic_swimming import problem, swimming

import mjfish
from mjfish.data import Dataset, Sensor, Trial
from mjfish.drive.wave import Wave
from mjfish.estimation import Score, fit, predict_held_out, sensor_noise
from mjfish.estimation.sensor_noise import joints_in_words, with_sensor_noise
from mjfish.fish.from_measurements import new_fish
from mjfish.model import Model
from mjfish.numerics.arrays import FloatArray, readonly


def test_runs_that_begin_with_a_wrong_heading_are_whitened_as_the_true_ones() -> None:
    """Errors of joint angles turn the fish, which then goes across its own heading, not across that of a fit.

    Along runs turned by 0.3 rad the sum of squares at the truth is that along the true ones, within 5 %; linearised
    along the turned rollouts themselves it would be 1.7 times that.
    """
    noise = (0.0005, 0.0005, 0.002)
    pool = mjfish.generate(
        "pike", ["v1", "v3-t1"], observe="pose", joints="measured", joint_noise=0.02, noise=noise, duration=8.0, seed=2
    )
    posed = problem(pool)
    truth = posed.start(posed.model.values())
    turned = posed.start({**posed.named(truth), **{f"{trial.name}:start.yaw": 0.3 for trial in pool.trials}})
    here, there = (with_sensor_noise(posed, along).residual(truth) for along in (truth, turned))
    assert float(there @ there) == pytest.approx(float(here @ here), rel=0.05)


def test_a_held_out_run_is_predicted_from_what_its_first_quarter_tells_of_its_joints() -> None:
    """Errors of the joints turn a run. Those of its first quarter are known, and later samples are whitened given them.

    Of six seeds the error of every channel at the true coefficients is 0.37 to 0.95 of what the rollout alone leaves.
    """
    noise = (0.0005, 0.0005, 0.002)
    runs = ["v1", "v3-t1", "v3-t2", "v5"]
    pool = mjfish.generate(
        "pike", runs, observe="pose", joints="measured", joint_noise=0.02, noise=noise, duration=8.0, seed=2
    )
    posed = problem(pool)
    truth = posed.model.values()
    posed = with_sensor_noise(posed, posed.start(truth))
    told, alone = (predict_held_out(one, truth, pool.trials) for one in (posed, replace(posed, joint_errors=None)))

    def squares(score: Score) -> FloatArray:
        return np.asarray(
            np.mean([[np.mean(channel.residual**2) for channel in run] for run in score.channels], axis=0)
        )

    assert np.all(np.sqrt(squares(told) / squares(alone)) < 0.8)
    assert all(0.6 < float(np.mean(white**2)) < 1.1 for white in told.whitened)


@pytest.mark.parametrize(("matters", "told"), [(100.0, "do not matter"), (0.1, "matter: they are counted as noise")])
def test_it_is_said_whether_errors_of_measured_joints_matter(
    monkeypatch: pytest.MonkeyPatch, matters: float, told: str
) -> None:
    monkeypatch.setattr(sensor_noise, "_MATTERS", matters)
    noise = (0.003, 0.003, 0.02)
    pool = mjfish.generate(
        "pike", ["v1"], observe="pose", joints="measured", joint_noise=0.002, noise=noise, duration=3
    )
    posed = problem(pool)
    (said,) = joints_in_words(with_sensor_noise(posed, posed.start(posed.model.values())))
    assert told in said
    assert said.startswith("errors of the recorded joint angles in v1 ")
    assert [*joints_in_words(problem(swimming(pool.fish)))] == []


@pytest.mark.parametrize("seed", [12, 17])
def test_a_fish_at_rest_begins_with_what_its_measured_joints_say_of_its_motion(seed: int) -> None:
    """Their rates have errors at the first sample, and the recoil of these is more than a linear filter allows for.

    From a start without any motion, a sample leaves a mean square of 1.5 and 2.0 at the true coefficients.
    """
    rng, time = np.random.default_rng(seed), readonly(np.arange(0.0, 2.0, 1.0 / 60.0))
    fish, still = new_fish("esox", length=0.614, mass=2.11, joints=4, height=0.1), np.zeros((len(time), 3))
    trials = []
    for name, beat, swing in (("fast", 1.8, 1.0), ("slow", 1.25, 0.9)):
        amplitude = (0.16 * swing, 0.24 * swing, 0.35 * swing, 0.45 * swing)
        wave = Wave(beat, amplitude, (0.0, -1.1, -2.2, -3.3), (0.0,) * 4, ramp=0.45)
        sensors = (
            Sensor("place", "position", time, still[:, :2], sigma=np.full(2, 0.0007)),
            Sensor("heading", "heading", time, still[:, :1], sigma=np.full(1, 0.0044)),
        )
        trial = Trial(name, "fit", time, readonly(still * np.nan), (), wave=wave, sensors=sensors)
        swum = Model(fish).predict(trial, fish.values)
        seen = tuple(
            replace(sensor, values=read + sensor.sigma * rng.standard_normal(read.shape))
            for sensor, read in zip(sensors, swum.sensors, strict=True)
        )
        angle = swum.rollout.motion.angle_at(time) + 0.01 * rng.standard_normal((len(time), 4))
        trials.append(replace(trial, wave=None, joint_angle=readonly(angle), from_rest=True, sensors=seen))
    posed = problem(Dataset("esox", fish, tuple(trials)), fixed=fish.values)
    found = fit(with_sensor_noise(posed, posed.start()))
    found = fit(with_sensor_noise(posed, found.x), found.x)
    assert found.sse / found.count < 1.1
