"""Bench calibrations know every shipped cause, and a cause of one's own by its family."""

from __future__ import annotations

from mjfish.design.calibration import CALIBRATIONS, settled, settling
from mjfish.effects import catalogue, find


def test_every_cause_is_measured_by_the_calibration_that_names_it_or_its_family() -> None:
    """A name here that no cause has would be a calibration that settles nothing."""
    known = catalogue()
    for effect in known.values():
        one = settling(effect)
        if one is None:
            assert effect.family == "water", effect.name
        else:
            assert effect.name in one.names or effect.family in one.families
    for name in ("time_offset", "servo_lag", "ambient_current", "reynolds_drag", "tail_compliance"):
        assert name in (settling(known[name]) or CALIBRATIONS[0]).names
    named = [name for one in CALIBRATIONS for name in one.names]
    assert len(set(named)) == len(named)


def test_one_log_of_the_joints_measures_both_causes_of_the_drive() -> None:
    found = settled([find("servo_lag"), find("time_offset")])
    assert [one.name for one in found] == ["sync-flash", "joint-log"]
    assert [[effect.name for effect in measured] for measured in found.values()] == [["time_offset"], ["servo_lag"]]
