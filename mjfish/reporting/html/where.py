"""Where the misfit sits, as groups of bars."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from mjfish.diagnosis import Diagnosis
from mjfish.diagnosis.locate import FIFTHS
from mjfish.frames import CHANNELS
from mjfish.reporting.html.words import CHANNEL_NAMES, percent

_PARTS = ("start-up", "transition", "steady")


@dataclass(frozen=True)
class Bar:
    """One share; `chief` where the misfit is densest, `length` in percent of the longest bar of its group."""

    name: str
    share: str
    length: float
    chief: bool


@dataclass(frozen=True)
class BarGroup:
    """Shares that add up to one."""

    title: str
    bars: tuple[Bar, ...]


def where_view(diagnosis: Diagnosis) -> tuple[BarGroup, ...]:
    """Return the shares by channel, trial, part of the run, phase, speed, turning; none where nothing was located."""
    where = diagnosis.where
    if where is None:
        return ()
    trials = [trial.name for trial in diagnosis.dataset.trials]
    names = {name: CHANNEL_NAMES[name] for name in CHANNELS}
    return (
        _group("channel", where.channels, CHANNELS, where.channel, names),
        _group("trial", where.trials, trials, where.trial),
        _group("part of the run", where.parts, _PARTS, where.part),
        _group("phase of the beat", where.phases, sorted(where.phases), where.phase),
        _group("surge", where.speeds, FIFTHS, where.speed),
        _group("|yaw rate|", where.turns, FIFTHS, where.turn),
    )


def _group(
    title: str, shares: Mapping[str, float], order: Iterable[str], chief: str, names: Mapping[str, str] | None = None
) -> BarGroup:
    longest = max([*shares.values(), 1e-12])
    listed = [*(name for name in order if name in shares), *(name for name in shares if name not in set(order))]
    bars = [
        Bar((names or {}).get(name, name), percent(shares[name], 2), 100.0 * shares[name] / longest, name == chief)
        for name in listed
    ]
    return BarGroup(title, tuple(bars))
