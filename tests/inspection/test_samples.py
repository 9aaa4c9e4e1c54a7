"""Faults of a recording that its own numbers show: copies, frozen frames, stuck and clipped channels, outliers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bad_data import good, only, remarked, spoiled, velocity, wrong
from true_values import TRUTH

from mjfish.data import Dataset
from mjfish.inspection import Inspection, inspect
from mjfish.inspection.samples import interpolated, outliers, stuck
from mjfish.numerics.arrays import FloatArray, readonly
from mjfish.simulation.synthetic import generate

#: Digits of a copy to the last bit.
EXACT = 0


def _and(name: str, of: str = "v1", role: str = "fit", start: int = 0, digits: int = EXACT) -> Dataset:
    """Add a copy of a trial."""
    base = good()
    trial = next(t for t in base.trials if t.name == of)
    values = trial.velocity[start:] if digits == EXACT else np.round(trial.velocity[start:], digits)
    copy = replace(trial, name=name, role=role, velocity=readonly(values), time=trial.time[: len(values)])  # type: ignore[arg-type]
    return replace(base, trials=(*base.trials, copy))


def test_a_copy_across_fit_and_held_out_blocks() -> None:
    """Catches a leak that makes any gain a gain."""
    found = only(inspect(_and("again", role="held_out")), "copies")
    assert found.severity == "blocks"
    assert found.trials == ("v1", "again")
    assert "held out" in found.found


def test_a_copy_that_was_rounded_is_found() -> None:
    """No number is the same. Catches a search for equal bits alone."""
    found = only(inspect(_and("again", digits=4)), "copies")
    assert found.severity == "suspect"
    assert found.trials == ("v1", "again")


def test_recordings_that_overlap_are_found() -> None:
    """The second begins two seconds into the first. Catches a comparison row by row."""
    found = [one for one in wrong(inspect(_and("later", of="v5", start=100))) if one.code.startswith("copies")]
    assert [one.trials for one in found] == [("v5", "later")]
    assert "261 rows" in found[0].found


def test_a_rounded_overlap_is_found() -> None:
    """Catches a correlation that favours a whole number of beats, where more rows overlap."""
    found = [
        one for one in wrong(inspect(_and("later", of="v5", start=100, digits=4))) if one.code.startswith("copies")
    ]
    assert [one.trials for one in found] == [("v5", "later")]


def test_runs_without_noise_that_are_equal_are_a_remark() -> None:
    """Catches simulated data that are refused because two runs of one drive are the same."""
    base = good()
    silent = generate(base.fish, ("v1", "v3", "v1"), values=TRUTH, duration=7.2)
    found = [finding for finding in inspect(silent).findings if finding.code.startswith("copies")]
    assert [(one.severity, one.trials) for one in found] == [("remark", ("v1", "v1.2"))]


def _hold(rows: slice, channels: slice) -> Inspection:
    def held(values: FloatArray) -> FloatArray:
        values[rows, channels] = values[rows.start - 1, channels]
        return values

    return inspect(spoiled(velocity(held), "v3"))


@pytest.mark.parametrize(("count", "words"), [(1, "1 row repeats"), (4, "4 rows repeat")])
def test_frozen_frames_are_counted_and_placed(count: int, words: str) -> None:
    """Catches a single frame that is missed, rows counted from 0."""
    found = only(_hold(slice(200, 200 + count), slice(None)), "stuck")
    assert found.trials == ("v3",)
    assert "row 201 (4.000 s)" in found.place
    assert words in found.found
    assert "gaps = true" in found.remedy


def test_the_remedy_where_joints_were_recorded_is_one_that_reading_allows() -> None:
    """Frozen frames, a stuck and a clipped channel, an outlier. Catches gaps where dataset.toml refuses them."""
    (base, *_) = good(("v1", "v3")).trials
    values = base.velocity.copy()
    values[200:203] = values[199]
    values[240:252, 0] = values[239, 0]
    values[:, 1] = np.clip(values[:, 1], -0.5 * values[:, 1].max(), 0.5 * values[:, 1].max())
    spiked = base.velocity.copy()
    spiked[300, 1] += 1.5
    angle = readonly(0.3 * np.sin(18.0 * base.time)[:, None] * np.ones(4))
    for measured in (False, True):
        trial = replace(base, drive=(), joint_angle=angle) if measured else base
        steady = replace(trial, time=readonly(base.time[150:]), velocity=readonly(spiked[150:]))
        line = interpolated(replace(steady, joint_angle=readonly(angle[150:])) if measured else steady)
        assert line is not None
        found = [*stuck(replace(trial, velocity=readonly(values))), *outliers([line])]
        remedies = {finding.code: finding.remedy for finding in found}
        assert set(remedies) == {"stuck-frozen", "stuck-held", "stuck-clipped", "outliers-samples"}
        for remedy in remedies.values():
            assert ("gaps = true" in remedy) != measured
            assert ("cut the run there into two trials" in remedy) == measured


def test_a_stuck_channel_is_named_with_its_rows() -> None:
    """Catches a look at whole rows alone."""
    found = only(_hold(slice(200, 212), slice(0, 1)), "stuck")
    assert found.channels == ("surge",)
    assert "rows 200 to 212" in found.place


def test_a_channel_that_was_not_recorded_blocks() -> None:
    """Catches a division by its zero range, and a trial of zeros that is judged further."""
    found = only(inspect(spoiled(velocity(lambda v: v * [1, 0, 1]), "v3")), "stuck")
    assert found.severity == "blocks"
    assert (found.trials, found.channels) == (("v3",), ("sway",))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_clipped_sensor_is_named_with_its_limit(sign: float) -> None:
    """Catches one end of the range forgotten; a saturated servo must not be named from such data."""

    def clip(values: FloatArray) -> FloatArray:
        limit = np.quantile(sign * values[:, 2], 0.95)
        values[:, 2] = sign * np.minimum(sign * values[:, 2], limit)
        return values

    found = only(inspect(spoiled(velocity(clip), "v3")), "stuck")
    assert (found.trials, found.channels) == (("v3",), ("yaw_rate",))
    assert "servo_saturation" in found.cannot_tell
    assert ("none is above" if sign > 0 else "none is below") in found.found


def test_rounded_values_are_not_clipped_or_stuck() -> None:
    """A hundredth of a unit a step: many values repeat. Catches equality that is taken for a fault."""
    assert wrong(inspect(spoiled(velocity(lambda v: np.round(v, 2))))) == []


def test_an_outlier_is_named_with_row_and_channel() -> None:
    """Catches a line that the outlier bends, and its neighbours named beside it."""

    def spike(values: FloatArray) -> FloatArray:
        values[250, 1] += 1.5
        return values

    found = only(inspect(spoiled(velocity(spike), "v5")), "outliers")
    assert (found.trials, found.channels) == (("v5",), ("sway",))
    assert "row 251 (5.000 s)" in found.place
    assert "more" not in found.place


def test_heavy_tails_are_a_remark() -> None:
    """Student t of 3 degrees of freedom: every trial has samples beyond 6 sigma. Catches them blamed one by one."""
    rng = np.random.default_rng(4)
    heavy = spoiled(velocity(lambda v: v + rng.standard_t(3, v.shape) * [0.008, 0.008, 0.05]))
    found = inspect(heavy)
    assert wrong(found) == []
    assert remarked(found, "outliers")
