"""What moves the joints of an imported record: columns of measured angles, or a law."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from mjfish.arrays import FloatArray, readonly
from mjfish.data.importers.mapping import ANGLES, Driven
from mjfish.data.read import wave_of
from mjfish.drive.wave import Wave
from mjfish.errors import InputError
from mjfish.fish import Fish


def angles(table: Driven, numbers: Mapping[str, FloatArray], fish: Fish, mapping: Path) -> FloatArray | None:
    """Return the measured joint angles (n, joints) [rad], None where a law gives them."""
    if table.joints is None:
        return None
    names = table.joints.columns
    if len(names) != fish.joints:
        raise InputError(
            f"{mapping}: joints.columns: {len(names)} columns, expected {fish.joints}, one for each joint of fish "
            f"'{fish.name}'; correct it"
        )
    factor = ANGLES[table.joints.unit] * table.joints.sign
    return readonly(factor * np.column_stack([numbers[name] for name in names]))


def wave(table: Driven, fish: Fish, mapping: Path) -> Wave | None:
    """Return the law of the joints, None where their angles were measured."""
    law = table.wave
    return None if law is None else wave_of(law, fish, f"{mapping}: wave", ANGLES[law.unit])


def columns(table: Driven) -> tuple[str, ...]:
    """Return the columns that the joint angles are in."""
    return () if table.joints is None else table.joints.columns
