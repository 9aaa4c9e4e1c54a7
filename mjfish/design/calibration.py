"""Bench calibrations: what settles a cause without a run, by measuring it directly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mjfish.effects.effect import Effect, Family


@dataclass(frozen=True)
class Calibration:
    """A direct measurement on the bench.

    Attributes:
        name: of the calibration.
        about: what is done.
        names: causes that it measures.
        families: of causes that it measures where no calibration names them.
    """

    name: str
    about: str
    names: tuple[str, ...] = ()
    families: tuple[Family, ...] = ()


#: From the quickest to the most laborious.
CALIBRATIONS: tuple[Calibration, ...] = (
    Calibration("sync-flash", "flash a light in the camera's view when the drive starts", ("time_offset",)),
    Calibration(
        "scale-bar",
        "film a bar of known length and bearing, and the fish at rest along it",
        ("velocity_scale", "frame_misalignment", "marker_offset"),
        ("data",),
    ),
    Calibration("drift", "film the fish drifting without drive in the filled tank", ("ambient_current",)),
    Calibration(
        "joint-log",
        "log commanded and real joint angles on the bench, through steps and sweeps",
        ("servo_lag", "servo_rate_limit", "servo_saturation", "servo_backlash", "joint_zero_offset"),
        ("drive",),
    ),
    Calibration("roll-log", "record the roll with an inertial unit or a second camera", ("roll",), ("out_of_plane",)),
    Calibration("calipers", "measure the height of the sections", ("section_height",)),
    Calibration(
        "weighing", "weigh, balance and swing the links", ("mass_error", "com_offset", "inertia_error"), ("body",)
    ),
    Calibration("spring-balance", "hold the peduncle and load the fin with a spring balance", ("tail_compliance",)),
    Calibration(
        "tow-test",
        "tow the stretched fish at several speeds and small angles, and measure the force",
        ("reynolds_drag", "linear_drag", "fin_lift", "munk_moment"),
    ),
)  # fmt: skip


def settling(effect: Effect) -> Calibration | None:
    """Return the calibration that measures a cause directly; None where only swimming shows it."""
    by_name = next((one for one in CALIBRATIONS if effect.name in one.names), None)
    return by_name or next((one for one in CALIBRATIONS if effect.family in one.families), None)


def settled(rivals: Sequence[Effect]) -> dict[Calibration, tuple[Effect, ...]]:
    """Return, from the quickest, the calibrations that measure some of the rivals, and which."""
    found = {one: tuple(rival for rival in rivals if settling(rival) == one) for one in CALIBRATIONS}
    return {one: measured for one, measured in found.items() if measured}
