"""The ten modes of Table IV."""

from __future__ import annotations

import pytest

from mjfish.drive import modes
from mjfish.drive.modes import drive
from mjfish.errors import UnknownNameError

T1, T2, STRAIGHT = (0.0, 0.5, 1.0, 1.5), (0.0, 1.0, 1.5, 2.0), (0.0, 0.0, 0.0, 0.0)
#: (start, omega, bias) of each segment, spelled out from the paper: omega = 16 + 2x, changes at 5.2 s.
TABLE = {
    "v1": [(0.0, 18.0, STRAIGHT)],
    "v3": [(0.0, 22.0, STRAIGHT)],
    "v5": [(0.0, 26.0, STRAIGHT)],
    "v7": [(0.0, 30.0, STRAIGHT)],
    "v1-v5": [(0.0, 18.0, STRAIGHT), (5.2, 26.0, STRAIGHT)],
    "v5-v1": [(0.0, 26.0, STRAIGHT), (5.2, 18.0, STRAIGHT)],
    "v1-t1": [(0.0, 18.0, STRAIGHT), (5.2, 18.0, T1)],
    "v1-t2": [(0.0, 18.0, STRAIGHT), (5.2, 18.0, T2)],
    "v3-t1": [(0.0, 22.0, STRAIGHT), (5.2, 22.0, T1)],
    "v3-t2": [(0.0, 22.0, STRAIGHT), (5.2, 22.0, T2)],
}


@pytest.mark.parametrize("mode", TABLE)
def test_every_mode_of_the_table(mode: str) -> None:
    assert [(s.start, s.omega, s.bias) for s in drive(mode)] == TABLE[mode]


def test_the_modes_are_those_of_the_table_in_its_order() -> None:
    assert tuple(TABLE) == modes.MODES
    assert modes.DURATION == 10.4


@pytest.mark.parametrize("name", ["v2", "t1", "v1-t3", "V1", ""])
def test_an_unknown_mode_is_refused_with_the_known_ones(name: str) -> None:
    with pytest.raises(UnknownNameError, match=r"known: v1, v1-t1, .*v7"):
        drive(name)
