"""What stands between the command and the joints: amplitude, stick, stops, the servo itself, zeros."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mjfish.numerics.arrays import FloatArray
from studies.battery.generator import actuator, other_servos
from studies.battery.generator.oscillator import Stretch
from studies.battery.generator.plans import Run

#: The amplitude follows a change of its cause within this time [s].
_SETTLE = 0.1
#: Length and edge of one stick of a joint, and how often on average [s].
_STICK, _EDGE, _EVERY = 0.16, 0.03, 1.2

Psi = Mapping[str, float]


def joints(asked: tuple[Stretch, ...], run: Run, psi: Psi) -> tuple[Stretch, ...]:
    """Return what the joints did, from what the CPG asked."""
    got = asked
    if any(psi.get(name) for name in ("fading_battery.rate", "frequency_gain.size", "bad_run.size")):
        got = _amplitude(got, run, psi)
    if psi.get("sticking_joint.size"):
        got = _stuck(got, run, psi)
    if psi.get("servo_saturation.psi"):
        got = _saturated(got, psi["servo_saturation.psi"])
    if psi.get("servo_rate_limit.slowness"):
        got = tuple(actuator.limited(got, psi["servo_rate_limit.slowness"]))
    if psi.get("servo_lag.time_constant"):
        got = tuple(actuator.second_order(got, psi["servo_lag.time_constant"]))
    got = other_servos.joints(got, psi)
    plays, zero = (
        np.array([psi.get(f"{cause}.joint_{i + 1}", 0.0) for i in range(got[0].angle.shape[2])])
        for cause in ("servo_backlash", "joint_zero_offset")
    )
    if np.any(plays):
        got = tuple(actuator.played(got, plays))
    if np.any(zero):
        got = tuple(replace(part, angle=part.angle + zero) for part in got)
    return got


def nodes(part: Stretch) -> FloatArray:
    """Return the times (steps, 3) of start, middle, end of every step."""
    start = part.start + part.step * np.arange(part.steps)
    return np.asarray(start[:, None] + part.step * np.array([0.0, 0.5, 1.0]))


def _amplitude(asked: tuple[Stretch, ...], run: Run, psi: Psi) -> tuple[Stretch, ...]:
    """Scale the strokes: exp(-rate t) over the session, 1 / (1 + a (omega / 20)^2), or one run that is weak."""
    got = []
    before = None
    for part, segment in zip(asked, run.drive, strict=False):
        bad = psi.get("bad_run.size", 0.0) if run.number == int(psi.get("bad_run.number", -1)) else 0.0
        level = (1.0 - bad) / (1.0 + psi.get("frequency_gain.size", 0.0) * (segment.omega / 20.0) ** 2)
        before = level if before is None else before
        t = nodes(part)[..., None]
        settle = (before - level) * np.exp(-(t - part.start) / _SETTLE)
        fade = psi.get("fading_battery.rate", 0.0)
        left = np.exp(-fade * (run.session + t))
        gain = (level + settle) * left
        slope = -settle / _SETTLE * left - fade * gain
        got.append(replace(part, angle=gain * part.angle, rate=gain * part.rate + slope * part.angle))
        before = level
    return tuple(got)


def _stuck(asked: tuple[Stretch, ...], run: Run, psi: Psi) -> tuple[Stretch, ...]:
    """Hold one joint now and then, for a tenth of a second, with smooth edges."""
    joint = int(psi["sticking_joint.joint"])
    rng = np.random.default_rng([int(psi["sticking_joint.seed"]), run.number])
    times = np.cumsum(0.5 + rng.exponential(_EVERY - 0.5, size=40))
    got = []
    for part in asked:
        angle, rate = part.angle.copy(), part.rate.copy()
        t = nodes(part)
        for begin in times[(times > part.start) & (times < t[-1, -1] - _STICK)]:
            x = (t - begin) / _EDGE
            out = (begin + _STICK - t) / _EDGE
            window = _ramp(x) * _ramp(out)
            slope = (_ramp_rate(x) * _ramp(out) - _ramp(x) * _ramp_rate(out)) / _EDGE
            held = np.interp(begin, t[:, 0], part.angle[:, 0, joint])
            size = psi["sticking_joint.size"]
            rate[..., joint] += size * (slope * (held - angle[..., joint]) - window * rate[..., joint])
            angle[..., joint] += size * window * (held - angle[..., joint])
        got.append(replace(part, angle=angle, rate=rate))
    return tuple(got)


def _ramp(x: FloatArray) -> FloatArray:
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * np.clip(x, 0.0, 1.0)))


def _ramp_rate(x: FloatArray) -> FloatArray:
    return np.asarray(np.where((x > 0.0) & (x < 1.0), 0.5 * np.pi * np.sin(np.pi * np.clip(x, 0.0, 1.0)), 0.0))


def _saturated(asked: tuple[Stretch, ...], psi: float) -> tuple[Stretch, ...]:
    """Theta = a tanh(c / a), whose cubic, -c^3 / (3 a^2), is the -psi c^3 / 2 of the solver's definition."""
    a = np.sqrt(2.0 / (3.0 * psi))
    got = []
    for part in asked:
        angle = a * np.tanh(part.angle / a)
        got.append(replace(part, angle=angle, rate=(1.0 - (angle / a) ** 2) * part.rate))
    return tuple(got)
