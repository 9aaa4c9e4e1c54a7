"""What a dataset can never show is said in remarks, with the causes concerned."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from bad_data import good, wrong

from mjfish.data import Dataset
from mjfish.data.validation import beats
from mjfish.drive.wave import Wave
from mjfish.effects import catalogue
from mjfish.inspection import EVERYTHING, Finding, Inspection, inspect
from mjfish.inspection.runs import missing_runs
from mjfish.numerics.arrays import readonly


def _said(dataset: Dataset) -> dict[str, Finding]:
    found = inspect(dataset)
    assert wrong(found) == []
    return {finding.found: finding for finding in found.findings if finding.code.startswith("design")}


def _of(*names: str) -> Dataset:
    base = good()
    return replace(base, trials=tuple(replace(t, role=None) for t in base.trials if t.name in names))


def test_a_rich_dataset_has_nothing_missing() -> None:
    """Catches remarks that are always made."""
    assert _said(good()) == {}


def test_one_run_shows_no_cause() -> None:
    """Catches a verdict that needs another run."""
    said = _said(_of("v1"))
    assert said["the dataset has one run"].cannot_tell == (EVERYTHING,)


def test_one_frequency_hides_what_goes_with_frequency() -> None:
    """v1, v1.2 and v1-t1 beat alike. Catches a count of drives in place of frequencies."""
    said = next(one for text, one in _said(_of("v1", "v1.2", "v1-t1")).items() if "one frequency (2.86 Hz)" in text)
    assert {"reynolds_drag", "servo_lag", "time_offset", "ambient_current"} <= set(said.cannot_tell)
    steady = {name for name, one in catalogue().items() if one.fingerprint.exponent == 0.0}
    assert not steady & set(said.cannot_tell)


def test_no_turn_is_said() -> None:
    """Catches a bias that is looked for in held-out runs, or in the first segment alone."""
    said = _said(_of("v1", "v3", "v5"))
    assert "ambient_current" in said["no fitted run turns"].cannot_tell
    assert "no fitted run turns" not in _said(_of("v1", "v3", "v1-t1"))


def test_a_wave_with_a_bias_turns() -> None:
    """50 degrees of bias in the last joint. Catches a turn that is looked for in CPG drives alone."""

    def waved(bias: float) -> Dataset:
        wave = Wave(2.1, (0.1,) * 4, (0.0,) * 4, (0.0, 0.0, 0.0, bias), ramp=0.5)
        return replace(good(), trials=tuple(replace(trial, drive=(), wave=wave) for trial in good().trials))

    assert "design-no-turn" in {finding.code for finding in missing_runs(waved(0.0), {})}
    assert "design-no-turn" not in {finding.code for finding in missing_runs(waved(math.radians(50.0)), {})}
    assert beats(waved(0.0).trials[0]) == [2.1]


def test_no_held_out_run_is_said() -> None:
    """Catches the split by default taken for one that was given."""
    base = good()
    fitted = replace(base, trials=tuple(replace(t, role="fit") for t in base.trials))
    assert "no run is held out" in _said(fitted)


def test_short_runs_are_said() -> None:
    """1.2 s are 3 to 5 beats. Catches seconds in place of beats."""
    base = good()
    short = replace(base, trials=tuple(replace(t, time=t.time[:60], velocity=t.velocity[:60]) for t in base.trials))
    assert any("shorter than 5 beats" in text for text in _said(short))


def test_a_start_is_seen_where_the_joints_were_measured() -> None:
    """The fish gathers speed. Catches a start that is looked for in what is known of the drive alone."""

    def recorded(first: float) -> Dataset:
        trials = []
        for trial in good().trials:
            kept = trial.time >= first
            angle = readonly(np.zeros((int(kept.sum()), 4)))
            time, velocity = readonly(trial.time[kept]), readonly(trial.velocity[kept])
            trials.append(replace(trial, drive=(), joint_angle=angle, time=time, velocity=velocity))
        return replace(good(), trials=tuple(trials))

    assert "design-no-start" not in {finding.code for finding in missing_runs(recorded(0.0), {})}
    assert "design-no-start" in {finding.code for finding in missing_runs(recorded(2.5), {})}


def test_the_summary_says_what_was_looked_at() -> None:
    """Also where something was found, in ten lines at most."""
    finding = Finding("design-no-turn", "remark", "dataset", "no run turns", "one that does", "add one")
    nothing, much = (found.summary().splitlines() for found in (Inspection(), Inspection((finding,) * 20)))
    assert nothing[0].startswith("Nothing was found in the data (mjfish.inspect looks at signs, units, labels, clocks,")
    assert much[0].startswith("Findings: 20 remark (mjfish.inspect looks at signs, units, labels, clocks,")
    assert (len(nothing), len(much), much[-1]) == (1, 9, "and 13 more")
