"""Bench measurements that settle a cause without a run, from the quickest to the most laborious.

An effect names the one that measures it in `Effect.calibration`; `DOMAINS` has those of effects that name none.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Calibration:
    """A direct measurement on the bench.

    Attributes:
        name: of the calibration.
        about: what is done.
    """

    name: str
    about: str


SYNC_FLASH = Calibration("sync-flash", "flash a light in the camera's view when the drive starts")
SCALE_BAR = Calibration("scale-bar", "film a bar of known length and bearing, and the fish at rest along it")
DRIFT = Calibration("drift", "film the fish drifting without drive in the filled tank")
JOINT_LOG = Calibration("joint-log", "log commanded and real joint angles on the bench, through steps and sweeps")
ROLL_LOG = Calibration("roll-log", "record the roll with an inertial unit or a second camera")
CALIPERS = Calibration("calipers", "measure the height of the sections")
WEIGHING = Calibration("weighing", "weigh, balance and swing the links")
SPRING_BALANCE = Calibration("spring-balance", "hold the peduncle and load the fin with a spring balance")
TOW_TEST = Calibration("tow-test", "tow the stretched fish at several speeds and small angles, and measure the force")

CALIBRATIONS = (
    SYNC_FLASH, SCALE_BAR, DRIFT, JOINT_LOG, ROLL_LOG, CALIPERS, WEIGHING, SPRING_BALANCE, TOW_TEST,
)  # fmt: skip

#: By the domain of an effect that names no calibration.
DOMAINS = {"data": SCALE_BAR, "drive": JOINT_LOG, "out_of_plane": ROLL_LOG, "body": WEIGHING}
