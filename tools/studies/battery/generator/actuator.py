"""Servos that move: second order, of limited rate, with play; compiled."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from mjfish.numerics.arrays import FloatArray
from studies.battery.generator.compiled import compiled
from studies.battery.generator.oscillator import Stretch

#: Damping of the second-order servo; with it the delay at low frequency is 2 zeta / omega_n = 1.6 / omega_n.
ZETA = 0.8
#: Rate at which a joint behind its command closes in on it [1/s].
CATCH_UP = 100.0
#: Gears come to rest on each other with this natural frequency [rad/s] and damping: a delay of 10 ms.
CONTACT, CONTACT_DAMPING = 140.0, 0.7
#: Parts of half a step in which gears and limits are resolved [s].
_PART = 2.5e-4


def second_order(asked: tuple[Stretch, ...], delay: float, zeta: float = ZETA) -> Iterator[Stretch]:
    """Theta'' = wn^2 (command - theta) - 2 zeta wn theta', from rest at the command; its delay is 2 zeta / wn."""
    state = np.zeros((2, asked[0].angle.shape[2]))
    state[0] = asked[0].angle[0, 0]
    yield from _through(asked, state, _follow, 2.0 * zeta / delay, zeta)


def limited(asked: tuple[Stretch, ...], slowness: float) -> Iterator[Stretch]:
    """Theta' = c' + k (c - theta), cut off sharply at 1 / slowness either way."""
    state = asked[0].angle[0, :1].copy()
    yield from _through(asked, state, _limit, 1.0 / slowness, CATCH_UP, 1.0)


def looped(asked: tuple[Stretch, ...], slowness: float, lag: float) -> Iterator[Stretch]:
    """Theta' = (c - theta) / lag, cut off sharply at 1 / slowness either way; from rest at the command."""
    state = asked[0].angle[0, :1].copy()
    largest = 1.0 / slowness if slowness > 0.0 else np.inf
    yield from _through(asked, state, _limit, largest, 1.0 / lag, 0.0)


def played(asked: tuple[Stretch, ...], plays: FloatArray) -> Iterator[Stretch]:
    """The play operator; what it takes off the command comes out through a second-order lag, as gears give a little."""
    state = np.zeros((3, asked[0].angle.shape[2]))  # what the play takes off; that lagged; its rate
    yield from _through(asked, state, _play, plays, 0.0)


def _through(
    asked: tuple[Stretch, ...], state: FloatArray, run: Callable[..., Any], *numbers: FloatArray | float
) -> Iterator[Stretch]:
    for part in asked:
        angle, rate = np.empty_like(part.angle), np.empty_like(part.rate)
        run(part.angle, part.rate, part.step, *numbers, state, angle, rate)
        yield replace(part, angle=angle, rate=rate)


@compiled
def _cubic(command, slope, n, node, j, d, s):  # type: ignore[no-untyped-def]
    """Return the command and its rate at the share s of the half step in front of a node."""
    a = command[n, node - 1, j]
    b = command[n, node, j]
    p = slope[n, node - 1, j] * d
    q = slope[n, node, j] * d
    c2 = 3.0 * (b - a) - 2.0 * p - q
    c3 = p + q - 2.0 * (b - a)
    return a + s * (p + s * (c2 + s * c3)), (p + s * (2.0 * c2 + 3.0 * s * c3)) / d


@compiled
def _follow(command, slope, h, wn, zeta, state, angle, rate):  # type: ignore[no-untyped-def]
    """Integrate the servo by the midpoint rule, in substeps that resolve it; the command is a cubic per half step."""
    d = 0.5 * h
    count = int(np.ceil(d * wn / 0.05))
    e = d / count
    for n in range(command.shape[0]):
        for node in range(3):
            for j in range(command.shape[2]):
                if node > 0:
                    for m in range(count):
                        asked, _ = _cubic(command, slope, n, node, j, d, (m + 0.5) / count)
                        # Implicit midpoint, solved for the new rate: stable however stiff.
                        pull = wn * wn * (asked - state[0, j] - 0.25 * e * state[1, j]) - zeta * wn * state[1, j]
                        new = (state[1, j] + e * pull) / (1.0 + e * zeta * wn + 0.25 * e * e * wn * wn)
                        state[0, j] += 0.5 * e * (state[1, j] + new)
                        state[1, j] = new
                angle[n, node, j] = state[0, j]
                rate[n, node, j] = state[1, j]


@compiled
def _limit(command, slope, h, largest, gain, forward, state, angle, rate):  # type: ignore[no-untyped-def]
    """Integrate a rate limiter, theta' = forward c' + gain (c - theta) cut off, by the explicit midpoint rule."""
    d = 0.5 * h
    count = int(np.ceil(d / min(_PART, 0.2 / gain)))
    e = d / count
    for n in range(command.shape[0]):
        for node in range(3):
            for j in range(command.shape[2]):
                if node > 0:
                    for m in range(count):
                        asked, turn = _cubic(command, slope, n, node, j, d, m / count)
                        first = min(max(forward * turn + gain * (asked - state[0, j]), -largest), largest)
                        asked, turn = _cubic(command, slope, n, node, j, d, (m + 0.5) / count)
                        middle = state[0, j] + 0.5 * e * first
                        state[0, j] += e * min(max(forward * turn + gain * (asked - middle), -largest), largest)
                wanted = forward * slope[n, node, j] + gain * (command[n, node, j] - state[0, j])
                angle[n, node, j] = state[0, j]
                rate[n, node, j] = min(max(wanted, -largest), largest)


@compiled
def _play(command, slope, h, plays, _unused, state, angle, rate):  # type: ignore[no-untyped-def]
    """Move the play and its lag; the lag by the midpoint rule."""
    d = 0.5 * h
    count = int(np.ceil(d / _PART))
    e = d / count
    w = CONTACT
    damping = 2.0 * CONTACT_DAMPING * w
    for n in range(command.shape[0]):
        for node in range(3):
            for j in range(command.shape[2]):
                if node > 0:
                    before = command[n, node - 1, j]
                    for m in range(count):
                        here, _ = _cubic(command, slope, n, node, j, d, (m + 1.0) / count)
                        after = min(max(state[0, j] + before - here, -0.5 * plays[j]), 0.5 * plays[j])
                        mean = 0.5 * (state[0, j] + after)
                        x = state[1, j] + 0.5 * e * state[2, j]
                        v = state[2, j] + 0.5 * e * (w * w * (mean - state[1, j]) - damping * state[2, j])
                        state[1, j] += e * v
                        state[2, j] += e * (w * w * (mean - x) - damping * v)
                        state[0, j] = after
                        before = here
                angle[n, node, j] = command[n, node, j] + state[1, j]
                rate[n, node, j] = slope[n, node, j] + state[2, j]
