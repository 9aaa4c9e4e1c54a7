"""Servos in foreign forms: with inertia, in a loop of limited rate, two lags and a dead time, a limit and a lag."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mjfish.numerics.arrays import FloatArray
from studies.battery.generator import actuator
from studies.battery.generator.oscillator import Stretch

#: Lag behind a limit [s].
_LAG = 0.002


def joints(asked: tuple[Stretch, ...], psi: Mapping[str, float]) -> tuple[Stretch, ...]:
    """Return what the joints did, from what was asked; all start from rest."""
    if psi.get("plant_with_inertia.delay"):
        delay, damping = psi["plant_with_inertia.delay"], psi["plant_with_inertia.damping"]
        return tuple(actuator.second_order(asked, delay, damping))
    if psi.get("limited_loop.slowness"):
        return tuple(actuator.looped(asked, psi["limited_loop.slowness"], psi["limited_loop.lag"]))
    if psi.get("two_lags.first"):
        late = delayed(asked, psi["two_lags.dead"])
        return _lagged(_lagged(late, psi["two_lags.first"]), psi["two_lags.second"])
    if psi.get("limit_then_lag.slowness"):
        return _lagged(tuple(actuator.limited(asked, psi["limit_then_lag.slowness"])), _LAG)
    return asked


def _lagged(asked: tuple[Stretch, ...], lag: float) -> tuple[Stretch, ...]:
    return tuple(actuator.looped(asked, 0.0, lag))


def delayed(asked: tuple[Stretch, ...], dead: float) -> tuple[Stretch, ...]:
    """Return what was asked a dead time before [s]; before the start, the start."""
    times = [part.start + 0.5 * part.step * np.arange(2 * part.steps + 1) for part in asked]
    got = []
    for part, own in zip(asked, times, strict=True):
        angle, rate = np.empty((2, len(own), part.angle.shape[2]))
        then = own - dead
        for number, (other, nodes) in enumerate(zip(asked, times, strict=True)):
            begins = then >= nodes[0] - 1e-12 if number else np.ones(len(then), dtype=bool)
            angle[begins], rate[begins] = _at(other, nodes, then[begins])
        resting = then < times[0][0]
        rate[resting] = 0.0
        index = np.add.outer(2 * np.arange(part.steps), np.arange(3))
        got.append(replace(part, angle=angle[index], rate=rate[index]))
    return tuple(got)


def _at(part: Stretch, nodes: FloatArray, time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return angle and rate (n, joints) of a stretch: cubics between start, middle and end of its steps."""
    angle = np.concatenate([part.angle[:, :2].reshape(-1, part.angle.shape[2]), part.angle[-1:, 2]])
    rate = np.concatenate([part.rate[:, :2].reshape(-1, part.rate.shape[2]), part.rate[-1:, 2]])
    d = nodes[1] - nodes[0]
    place = np.clip((time - nodes[0]) / d, 0.0, len(nodes) - 1.0)
    left = np.minimum(place.astype(int), len(nodes) - 2)
    s = (place - left)[:, None]
    a, b, p, q = angle[left], angle[left + 1], d * rate[left], d * rate[left + 1]
    c2, c3 = 3.0 * (b - a) - 2.0 * p - q, p + q - 2.0 * (b - a)
    return a + s * (p + s * (c2 + s * c3)), (p + s * (2.0 * c2 + 3.0 * s * c3)) / d
