"""Signs, units, labels and starts are held against the nominal simulation, before any fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bad_data import good, only, rows, spoiled, velocity, wrong

from mjfish.data import Trial
from mjfish.drive import modes
from mjfish.inspection import EVERYTHING, Inspection, inspect
from mjfish.inspection.runs import sampled_enough, time_factor
from mjfish.model import Model
from mjfish.numerics.arrays import readonly


def test_good_data_are_not_complained_of() -> None:
    """Catches a check that sees ghosts."""
    assert wrong(inspect(good())) == []


@pytest.mark.parametrize(
    ("signs", "channels", "remedy"),
    [
        ((-1, 1, 1), ("surge",), "multiply surge by -1"),
        ((1, -1, 1), ("sway",), "multiply sway by -1"),
        ((1, 1, -1), ("yaw_rate",), "multiply yaw_rate by -1"),
        ((1, -1, -1), ("sway", "yaw_rate"), "y to starboard"),
        ((-1, -1, 1), ("surge", "sway"), "x points to the tail"),
    ],
)
def test_a_wrong_sign_is_named_with_its_channel(signs: tuple[int, ...], channels: tuple[str, ...], remedy: str) -> None:
    """In all trials. Catches a sign that half a beat of clock shift hides, or the wrong channel named."""
    found = only(inspect(spoiled(velocity(lambda v: v * signs))), "signs")
    assert found.severity == "blocks"
    assert found.channels == channels
    assert found.place.startswith("all trials")
    assert remedy in found.message
    assert found.cannot_tell == (EVERYTHING,)


def test_a_wrong_sign_in_one_trial_names_that_trial() -> None:
    """Catches a vote of all trials that overrules one."""
    found = only(inspect(spoiled(velocity(lambda v: v * [1, 1, -1]), "v5")), "signs")
    assert found.trials == ("v5",)
    assert "trial 'v5', yaw_rate" in found.message


def test_swapped_columns_are_named() -> None:
    """Catches a correlation of channels that does not look across."""
    found = only(inspect(spoiled(velocity(lambda v: v[:, [1, 0, 2]]))), "signs")
    assert found.channels == ("surge", "sway")
    assert "swap surge and sway" in found.remedy


@pytest.mark.parametrize(
    ("factors", "channels", "remedy"),
    [
        ((1.0, 1.0, 180.0 / np.pi), {"yaw_rate"}, "pi/180"),
        ((1.0, 1.0, np.pi / 180.0), {"yaw_rate"}, "180/pi"),
        ((1e3, 1e3, 1.0), {"surge", "sway"}, "0.001"),
        ((100.0, 100.0, 1.0), {"surge", "sway"}, "0.01"),
    ],
)
def test_a_wrong_unit_is_named_with_its_factor(factors: tuple[float, ...], channels: set[str], remedy: str) -> None:
    """Catches the reciprocal factor, and a unit taken for a scale."""
    found = wrong(inspect(spoiled(velocity(lambda v: v * factors))))
    assert {one.code for one in found} == {"signs-unit"}
    assert {name for one in found for name in one.channels} == channels
    assert all(remedy in one.remedy and one.severity == "blocks" for one in found)


def test_times_in_milliseconds_are_named_and_not_simulated() -> None:
    """Two hours of swimming would take a minute. Catches a rollout before the look at the sampling."""
    found = only(inspect(spoiled(lambda t: replace(t, time=readonly(1e3 * t.time)))), "sampling")
    assert found.severity == "blocks"
    assert "0.001" in found.remedy


@pytest.mark.parametrize("driven", [True, False])
def test_times_and_lengths_in_wrong_units_are_both_named(driven: bool) -> None:
    """Times in ms, lengths in mm, of a CPG or of recorded joints. Catches lengths held against a slow motion."""

    def spoil(trial: Trial) -> Trial:
        motion = Model(base.fish).prepare(trial, base.fish.values).motion
        angle = np.stack([np.interp(trial.time, motion.time[:-1], motion.angle[:, 0, j]) for j in range(4)], axis=1)
        joints = {} if driven else {"drive": (), "joint_angle": readonly(angle)}
        wrong = replace(trial, time=readonly(1e3 * trial.time), velocity=readonly(trial.velocity * [1e3, 1e3, 1.0]))
        return replace(wrong, **joints)

    base = good(("v1", "v3"))
    found = {
        (one.code, one.channels): one
        for one in wrong(inspect(spoiled(spoil, dataset=base)))
        if one.code != "joints-unresolved"
    }
    time = "sampling-coarse" if driven else "sampling-unit"
    assert set(found) == {(time, ()), ("signs-unit", ("surge",)), ("signs-unit", ("sway",))}
    assert all(one.severity == "blocks" and "0.001" in one.remedy for one in found.values())


@pytest.mark.parametrize(("frequency", "factor"), [(0.002, 0.001), (0.05, 1.0), (20.0, 1.0), (2000.0, 1000.0)])
def test_a_slow_or_fast_beat_is_no_unit(frequency: float, factor: float) -> None:
    """Large fish beat slowly, small ones fast. Catches a factor for them."""
    phase = 2.0 * np.pi * 0.1 * np.arange(200)
    time = phase / (2.0 * np.pi * frequency)
    angles = readonly(0.3 * np.sin(phase)[:, None])
    assert time_factor(Trial("a", None, readonly(time), readonly(np.zeros((200, 3))), joint_angle=angles)) == factor


def _with_drive_of(first: str, second: str) -> Inspection:
    by_name = {trial.name: trial for trial in good().trials}
    drives = {first: by_name[second].drive, second: by_name[first].drive}
    return inspect(spoiled(lambda t: replace(t, drive=drives[t.name]), first, second))


def test_swapped_labels_are_named_as_a_pair() -> None:
    """Catches a look at one run at a time, and repeats that are blamed for it."""
    found = only(_with_drive_of("v1", "v5"), "labels")
    assert set(found.trials) == {"v1", "v5"}
    assert found.severity == "blocks"
    assert "swap the two files" in found.remedy


def test_a_drive_that_no_run_swam_is_named_with_both_frequencies() -> None:
    """v5 (4.14 Hz) under the drive of v1 (2.86 Hz): nobody is left who has the right one. Catches pairs alone."""
    drive = good().trials[0].drive
    found = only(inspect(spoiled(lambda t: replace(t, drive=drive), "v5")), "labels")
    assert found.trials == ("v5",)
    assert "4.1" in found.found
    assert "2.86 Hz" in found.found


def test_a_run_under_the_label_of_another_is_named() -> None:
    """v1-t1 says it is v5. Catches a label that only a swap would show."""
    drive = next(t for t in good().trials if t.name == "v5").drive
    found = only(inspect(spoiled(lambda t: replace(t, drive=drive), "v1-t1")), "labels")
    assert found.trials == ("v1-t1",)


def test_a_run_that_was_under_way_at_its_start_is_named() -> None:
    """Three seconds cut off in front, times from 0 on. Catches a start that is taken at its word."""

    def late(trial: Trial) -> Trial:
        return replace(trial, time=readonly(trial.time[:-150]), velocity=readonly(trial.velocity[150:]))

    found = only(inspect(spoiled(late, "v3")), "start")
    assert found.trials == ("v3",)
    assert "from the start of the drive" in found.remedy


def test_gaps_that_are_declared_are_no_fault() -> None:
    """A fifth of the rows lost, one hole of 20. Catches statistics over closed-up gaps."""
    rng = np.random.default_rng(3)

    def lost(trial: Trial) -> Trial:
        keep = rng.random(len(trial.time)) > 0.2
        keep[150:170] = False
        keep[0] = True
        return replace(rows(lambda _: keep)(trial), gaps=True)

    assert wrong(inspect(spoiled(lost))) == []


def test_an_hour_of_a_drive_is_not_in_another_unit() -> None:
    time = np.arange(180_000) / 50.0
    hour = Trial("a", None, readonly(time), readonly(np.zeros((len(time), 3))), modes.drive("v1"))
    assert sampled_enough(hour)
    assert time_factor(hour) == 1.0
