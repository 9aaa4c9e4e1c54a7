"""The band of many fish in the same run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mjfish.errors import InputError
from mjfish.simulation import Simulation, simulate

DRAGS = (1.6, 1.9, 2.2, 2.5, 2.8)


@pytest.fixture(scope="module")
def draws() -> list[Simulation]:
    return [simulate("pike", "v3-t1", values={"c_d.tail": drag}, duration=6.0) for drag in DRAGS]


def test_the_band_has_the_quantiles_of_every_sample(draws: list[Simulation]) -> None:
    """Of five fish the median is one of them; the others lie between the slowest two and the fastest two."""
    run = draws[1].with_band(draws)
    assert run.band is not None
    low, middle, high = run.band.velocity
    sorted_ = np.sort([draw.velocity for draw in draws], axis=0)
    np.testing.assert_array_equal(run.band.time, run.time)
    np.testing.assert_allclose(middle, sorted_[2], atol=1e-12)
    np.testing.assert_allclose(low, sorted_[0] + 0.2 * (sorted_[1] - sorted_[0]), atol=1e-12)
    np.testing.assert_allclose(high, sorted_[3] + 0.8 * (sorted_[4] - sorted_[3]), atol=1e-12)
    means = sorted(draw.velocity[len(draw.time) // 2 :, 2].mean() for draw in draws)
    assert run.band.mean_yaw_rate[1] == pytest.approx(means[2], abs=1e-12)
    assert "5 / 50 / 95 % of 5 draws: mean surge of the second half " in run.summary()
    assert run.to_dict()["band"]["fish"] == 5
    assert len(run.plot().data) == 6
    assert len(draws[1].plot().data) == 3


def test_it_is_written_with_its_levels(draws: list[Simulation], tmp_path: Path) -> None:
    band = draws[0].with_band(draws).band
    assert band is not None
    band.write_table(tmp_path / "band.csv")
    header, *rows = (tmp_path / "band.csv").read_text(encoding="utf-8").splitlines()
    assert header.startswith("time [s],surge_5 [m/s],surge_50 [m/s],surge_95 [m/s],sway_5 [m/s]")
    assert header.endswith("yaw_rate_5 [rad/s],yaw_rate_50 [rad/s],yaw_rate_95 [rad/s]")
    table = np.array([[float(cell) for cell in row.split(",")] for row in rows])
    np.testing.assert_array_equal(table[:, 0], band.time)
    np.testing.assert_array_equal(table[:, 7:], band.velocity[:, :, 2].T)


def test_draws_that_diverged_are_left_out(draws: list[Simulation]) -> None:
    lost = replace(draws[0], status="diverged", time=draws[0].time[:9], velocity=draws[0].velocity[:9])
    run = draws[1].with_band([lost, *draws[1:]])
    assert run.band is not None
    assert run.band.fish == 4
    with pytest.raises(InputError, match="v3-t1: none of the draws swam to the end; sample others"):
        draws[1].with_band([lost])


def test_another_run_is_refused(draws: list[Simulation]) -> None:
    """Catches a band over runs that have nothing to do with each other."""
    for other in (simulate("pike", "v3-t1", duration=5.9), replace(draws[0], fish="eth_tendon")):
        with pytest.raises(InputError, match=r"expected pike, v3-t1, 6 s; give draws of the same fish"):
            draws[0].with_band([draws[1], other])
