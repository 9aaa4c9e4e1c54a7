"""Plans of a day in the tank: which runs, how long, from where; drawn at random."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjfish.drive.cpg import DriveSegment

#: Bias of the joints in a full turn, nose first, [Yu2016] Table IV (t1).
_TURN = np.array([0.0, 0.5, 1.0, 1.5])
_OMEGA = (13.0, 28.0)
#: Pause between two runs [s].
_PAUSE = 40.0


@dataclass(frozen=True)
class Run:
    """A run as it is asked for.

    Attributes:
        name: of the trial.
        drive: segments of the CPG.
        duration: of the recording [s].
        start: x, y [m], yaw [rad] in the tank.
        held_out: not to be fitted.
        session: when in the session it starts [s].
        number: which run of the session it is.
    """

    name: str
    drive: tuple[DriveSegment, ...]
    duration: float
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)
    held_out: bool = False
    session: float = 0.0
    number: int = 0


@dataclass(frozen=True)
class Plan:
    """Runs of a session, and whether the pose, and the roll, are recorded."""

    runs: tuple[Run, ...]
    pose: bool
    roll: bool


def draw(
    rng: np.random.Generator,
    *,
    pose: bool | None = None,
    roll: bool | None = None,
    runs: int | None = None,
    joints: int = len(_TURN),
) -> Plan:
    """Draw a plan for a fish of so many joints.

    5 to 10 runs of 5 to 11 s, two or three of them held out at another frequency or turn.
    """
    count = int(rng.integers(5, 11)) if runs is None else runs
    seen = bool(rng.random() < 0.8) if pose is None else pose
    rolling = bool(rng.random() < 0.25) if roll is None else roll
    out = 3 if count >= 8 and rng.random() < 0.5 else 2
    kinds = ["straight", "turn", "step", *rng.choice(["straight", "turn", "step", "zigzag"], size=count)][: count - out]
    kinds += list(rng.choice(["straight", "turn", "step", "zigzag"], size=out))
    spread = np.linspace(*_OMEGA, count) + rng.uniform(-0.5, 0.5, size=count)
    omegas = rng.permutation(spread)
    drawn = []
    session = 0.0
    for number, (kind, omega) in enumerate(zip(kinds, omegas, strict=True)):
        duration = round(float(rng.uniform(5.0, 11.0)) / 0.02) * 0.02
        start = (*rng.uniform(-1.0, 1.0, size=2), rng.uniform(-np.pi, np.pi)) if seen else (0.0, 0.0, 0.0)
        drawn.append(
            Run(
                name=f"run{number + 1:02d}",
                drive=_drive(rng, str(kind), float(omega), duration, joints),
                duration=duration,
                start=(float(start[0]), float(start[1]), float(start[2])),
                held_out=number >= count - out,
                session=session,
                number=number,
            )
        )
        session += duration + _PAUSE
    order = rng.permutation(count)  # held-out runs are not the last of the session
    sessions = [run.session for run in drawn]
    places = {int(old): new for new, old in enumerate(order)}
    return Plan(
        tuple(
            Run(r.name, r.drive, r.duration, r.start, r.held_out, sessions[places[r.number]], places[r.number])
            for r in drawn
        ),
        seen,
        rolling,
    )


def _drive(rng: np.random.Generator, kind: str, omega: float, duration: float, joints: int) -> tuple[DriveSegment, ...]:
    """Return the segments of one run; frequencies and biases change as steps, in between two samples."""
    none, turn = np.zeros(joints), _TURN
    if joints != len(_TURN):  # the bend of the whole body is that of the pike
        turn = np.interp(np.linspace(0.0, 1.0, joints), np.linspace(0.0, 1.0, len(_TURN)), _TURN)
        turn = turn * (_TURN.sum() / max(turn.sum(), _TURN[-1]))
    bend = rng.choice([-1.0, 1.0]) * rng.uniform(0.4, 1.3) * turn
    when = _between(rng, rng.uniform(0.35, 0.6) * duration)
    if kind == "straight":
        return (_segment(0.0, omega, none),)
    if kind == "turn":
        first = none if rng.random() < 0.6 else bend
        return (_segment(0.0, omega, first), _segment(when, omega, bend - first))
    if kind == "step":
        other = float(np.clip(omega + rng.choice([-1.0, 1.0]) * rng.uniform(4.0, 9.0), *_OMEGA))
        return (_segment(0.0, omega, none), _segment(when, other, none))
    every = float(np.round(rng.uniform(1.0, 2.0), 3))
    starts = [0.0, *(_between(rng, t) for t in np.arange(every, duration - 0.5, every))]
    return tuple(_segment(t, omega, bend * (-1.0) ** i) for i, t in enumerate(starts))


def _between(rng: np.random.Generator, time: float) -> float:
    """Return a time near `time` at least 4 ms off every sample: where velocities jump, none may hang on rounding."""
    return float(np.round(0.02 * np.floor(time / 0.02) + rng.uniform(0.004, 0.016), 4))


def _segment(start: float, omega: float, bias: np.ndarray) -> DriveSegment:
    return DriveSegment(start, omega, tuple(float(b) for b in bias))
