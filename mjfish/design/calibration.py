"""Which rival causes a bench measurement would settle."""

from __future__ import annotations

from collections.abc import Sequence

from mjfish.effects.calibration import CALIBRATIONS, FAMILIES, Calibration
from mjfish.effects.effect import Effect


def settling(effect: Effect) -> Calibration | None:
    """Return the calibration that measures a cause directly; None where only swimming shows it."""
    return effect.calibration or FAMILIES.get(effect.family)


def settled(rivals: Sequence[Effect]) -> dict[Calibration, tuple[Effect, ...]]:
    """Return, from the quickest, the calibrations that measure some of the rivals, and which."""
    found = {one: tuple(rival for rival in rivals if settling(rival) == one) for one in CALIBRATIONS}
    return {calibration: measured for calibration, measured in found.items() if measured}
