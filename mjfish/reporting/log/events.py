"""What happens in a run, in words, at its time: start, changes of the drive, gaps, joints off their command, ends."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from mjfish.data import Trial
from mjfish.reporting.log.scene import Swim

#: A step between samples longer than this many is a gap.
_GAP = 1.5
#: A joint is off its command by more than this share of the largest command.
_OFF = 0.2


#: Time [s] and words.
Event = tuple[float, str]


def events_of(trial: Trial, held_out: bool, swims: Sequence[Swim]) -> tuple[Event, ...]:
    """Return the events of a trial, in the order of their times.

    Args:
        trial: what was measured.
        held_out: whether nothing was fitted to it.
        swims: measured, then simulated; the joints of a `ghost` are those of the command.
    """
    found = [_start(trial, held_out), *_drive(trial), *_gaps(trial), *_short(swims), *_ends(swims)]
    return tuple(sorted(found, key=lambda event: event[0]))


def _start(trial: Trial, held_out: bool) -> Event:
    part = "held-out run: nothing was fitted to it" if held_out else "fitted run"
    return float(trial.time[0]), f"start of a {part}{', from rest' if trial.starts_at_rest else ''}"


def _drive(trial: Trial) -> Iterator[Event]:
    for before, after in zip(trial.drive, trial.drive[1:], strict=False):
        changes = []
        if after.omega != before.omega:
            hertz = (segment.omega / (2.0 * math.pi) for segment in (before, after))
            changes.append("the beat goes from {:.3g} to {:.3g} Hz".format(*hertz))
        if after.bias != before.bias:
            changes.append("a turn begins" if any(after.bias) else "the turn ends")
        if changes:
            yield after.start, f"the drive changes: {' and '.join(changes)}"


def _gaps(trial: Trial) -> Iterator[Event]:
    steps = np.diff(trial.time)
    for k in np.flatnonzero(steps > _GAP * trial.step):
        yield float(trial.time[k]), f"no samples for {steps[k]:.2g} s"


def _short(swims: Sequence[Swim]) -> Iterator[Event]:
    """Yield, for each joint of each simulated fish, when it is first far off its command."""
    first, *others = swims
    for swim in others if first.ghost else ():
        asked = first.joint_angle[: len(swim.time)]
        limit = _OFF * float(np.abs(asked).max(initial=0.0))
        for joint, off in enumerate(np.abs(swim.joint_angle - asked).T, start=1):
            if limit > 0.0 and np.any(off > limit):
                k = int(np.argmax(off > limit))
                words = f"joint {joint} is {off[k]:.2g} rad off its command, for the first time"
                yield float(swim.time[k]), f"{swim.words or swim.swimmer}: {words}"


def _ends(swims: Sequence[Swim]) -> Iterator[Event]:
    last = max(float(swim.time[-1]) for swim in swims)
    for swim in swims:
        if swim.time[-1] < last - 1e-9:
            yield float(swim.time[-1]), f"{swim.words or swim.swimmer}: the simulation diverges"
