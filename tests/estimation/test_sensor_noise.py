"""What whitens the sensors of runs whose joints were measured is linearised where the fish was."""

from __future__ import annotations

import pytest
from synthetic_swimming import problem

import mjfish
from mjfish.estimation.sensor_noise import with_sensor_noise


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
