"""Bench calibrations: each cause is measured by the one that it names, or by that of its domain."""

from __future__ import annotations

from mjfish.design.planning import calibration_of
from mjfish.effects import catalogue
from mjfish.effects.calibration import CALIBRATIONS, DOMAINS


def test_every_cause_but_some_of_the_water_has_a_calibration() -> None:
    """Catches a cause whose calibration is missing from the list, and a calibration that settles nothing."""
    used = set()
    for effect in catalogue().values():
        calibration = calibration_of(effect)
        assert calibration in CALIBRATIONS or effect.domain == "water", effect.name
        assert effect.calibration is not None or calibration == DOMAINS.get(effect.domain)
        used.add(calibration)
    assert set(CALIBRATIONS) <= used
