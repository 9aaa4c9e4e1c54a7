"""The menu of runs: what a fish with this CPG can swim, and repeats of what it swam."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mjfish.data import Dataset, Trial
from mjfish.drive import cpg as hopf
from mjfish.drive import modes
from mjfish.drive.cpg import DriveSegment
from mjfish.errors import InputError
from mjfish.fish import Cpg
from mjfish.numerics.arrays import FloatArray, readonly
from mjfish.ode.rollout import STEP

#: Frequencies [rad/s] of [Yu2016] and half of its slowest; a dataset's own widen the range.
OMEGA = (9.0, 30.0)
#: Number of steady frequencies, and of pieces of a chirp.
_STEADY, _CHIRP = 6, 8
#: Bias of a turn, without the first joint, and of a C-bend, in units of each oscillator's amplitude sqrt(A).
_TURN, _BEND = 0.3, 0.3
#: Frequency at which the joints all but stand still [rad/s]; a CPG has no zero.
_HOLD = 0.1
#: A run may ask a joint for this much more angle or rate than the hardest run that it is known to follow.
_MARGIN = 1.05


@dataclass(frozen=True, eq=False)
class Run:
    """A run of the menu, not yet swum.

    Attributes:
        name: of the run; also the name of its trial.
        about: what is done, in words.
        trial: with its times and drive, or its joint angles; the velocities of a CPG run are zeros that nobody reads.
        repeat: whether it was swum before.
    """

    name: str
    about: str
    trial: Trial
    repeat: bool = False

    @property
    def seconds(self) -> float:
        """How long it is swum [s]."""
        return float(self.trial.time[-1] - self.trial.time[0])


@dataclass(frozen=True)
class Menu:
    """What may be asked of the fish.

    Attributes:
        duration: of a run [s]; None: that of the longest trial of the dataset.
        omega: slowest and fastest frequency [rad/s]; None: `OMEGA`, widened to the dataset's.
        pause: before a run, for the water to come to rest [s]; counted with it.
    """

    duration: float | None = None
    omega: tuple[float, float] | None = None
    pause: float = 30.0

    def __post_init__(self) -> None:
        """Refuse numbers that no run can have."""
        if self.duration is not None and not 1.0 <= self.duration < math.inf:
            raise InputError(f"a run of {self.duration:g} s, expected 1 s or more")
        if not 0.0 <= self.pause < math.inf:
            raise InputError(f"a pause of {self.pause:g} s, expected 0 s or more")
        if self.omega is not None and not 0.0 < self.omega[0] < self.omega[1] < math.inf:
            raise InputError(
                f"frequencies {self.omega[0]:g} to {self.omega[1]:g} rad/s, expected 0 < slowest < fastest"
            )

    def runs(self, dataset: Dataset) -> tuple[Run, ...]:
        """Return the runs: those of the CPG that its joints can follow, then repeats of the trials that are fitted.

        A joint is known to follow what the dataset and the modes of [Yu2016] ask of it.
        """
        fitted, _ = dataset.split()
        taken = {trial.name for trial in dataset.trials}
        found = [run for run in self._driven(dataset, fitted) if run.name not in taken]
        repeats = [
            Run(
                name=_free(f"{trial.name}-again", taken),
                about=f"swim {trial.name} once more",
                trial=replace(trial, name=_free(f"{trial.name}-again", taken), role="fit", source=None),
                repeat=True,
            )
            for trial in fitted
        ]
        return (*found, *repeats)

    def _driven(self, dataset: Dataset, fitted: Sequence[Trial]) -> Iterator[Run]:
        cpg = dataset.fish.cpg
        if cpg is None:
            return
        duration = self.duration or max(float(trial.time[-1]) for trial in dataset.trials)
        interval = float(np.median(np.concatenate([np.diff(trial.time) for trial in fitted])))
        time = readonly(np.arange(math.floor(duration / interval + 1e-9) + 1) * interval)
        known = [segment.omega for trial in dataset.trials for segment in trial.drive if segment.omega > _HOLD]
        low, high = self.omega or (min(OMEGA[0], *known, OMEGA[1]), max(*OMEGA, *known))
        reach = _reach(cpg, dataset.trials)
        for name, about, drive in _drives(cpg, low, high, float(time[-1])):
            if np.all(_hardest(cpg, drive, duration) <= _MARGIN * reach):
                yield Run(name, about, Trial(name, "fit", time, readonly(np.zeros((len(time), 3))), drive))


def _drives(cpg: Cpg, low: float, high: float, duration: float) -> Iterator[tuple[str, str, tuple[DriveSegment, ...]]]:
    """Name, description and drive of every run between two frequencies [rad/s]."""
    straight = (0.0,) * len(cpg.amplitude)
    size = np.sqrt(cpg.amplitude)
    behind = np.arange(len(size)) > 0 if len(size) > 1 else np.array([True])
    turn = tuple(float(b) for b in _TURN * size * behind)
    bend = tuple(float(b) for b in _BEND * size)
    middle, half = math.sqrt(low * high), 0.5 * duration

    def two(first: float, second: float, bias: tuple[float, ...] = straight) -> tuple[DriveSegment, ...]:
        return DriveSegment(0.0, first, straight), DriveSegment(half, second, bias)

    for omega in np.linspace(low, high, _STEADY).tolist():
        yield f"steady-{omega:.3g}", f"straight at {omega:.3g} rad/s", (DriveSegment(0.0, omega, straight),)
    for omega in (low, middle, high):
        for side, sign in (("left", 1.0), ("right", -1.0)):
            bias = tuple(sign * b + 0.0 for b in turn)
            yield f"turn-{side}-{omega:.3g}", f"from the start a turn to one side at {omega:.3g} rad/s", (
                DriveSegment(0.0, omega, bias),
            )  # fmt: skip
    yield "into-turn", f"straight at {middle:.3g} rad/s, at half time a turn", two(middle, middle, turn)
    yield "step-up", f"{low:.3g}, at half time {high:.3g} rad/s", two(low, high)
    yield "step-down", f"{high:.3g}, at half time {low:.3g} rad/s", two(high, low)
    pieces = np.geomspace(low, high, _CHIRP).tolist()
    for name, row in (("chirp-up", pieces), ("chirp-down", pieces[::-1])):
        about = f"{row[0]:.3g} to {row[-1]:.3g} rad/s in {_CHIRP} steps"
        yield name, about, tuple(DriveSegment(i * duration / _CHIRP, w, straight) for i, w in enumerate(row))
    weave = [tuple((-1.0) ** i * b + 0.0 for b in turn) for i in range(_CHIRP // 2)]
    yield "zigzag", f"turns to either side at {middle:.3g} rad/s", tuple(
        DriveSegment(2.0 * i * duration / _CHIRP, middle, bias) for i, bias in enumerate(weave)
    )  # fmt: skip
    yield "burst-and-coast", f"beats at {high:.3g} rad/s and holds still, by turns", tuple(
        DriveSegment(2.0 * i * duration / _CHIRP, high if i % 2 == 0 else _HOLD, straight) for i in range(_CHIRP // 2)
    )  # fmt: skip
    yield "coast-down", f"straight at {high:.3g} rad/s, at half time the joints hold still", two(high, _HOLD)
    slow = max(low, 2.2 * math.pi / half)  # one beat at least before the bend
    yield "c-bend", f"beats at {slow:.3g} rad/s, at half time a bend to one side that is held", two(slow, _HOLD, bend)


def _reach(cpg: Cpg, trials: Sequence[Trial]) -> FloatArray:
    """Return the largest angle [rad] and rate [rad/s] (2,) that a joint is known to follow; all have one servo."""
    joints = len(cpg.amplitude)
    drives = {(trial.drive, float(trial.time[-1])) for trial in trials if trial.drive}
    drives |= {(modes.drive(mode, joints), modes.DURATION) for mode in modes.MODES}
    return np.asarray(np.max([_hardest(cpg, drive, duration) for drive, duration in drives], axis=0, initial=0.0))


def _hardest(cpg: Cpg, drive: tuple[DriveSegment, ...], duration: float) -> FloatArray:
    motion = hopf.joint_motion(cpg, drive, duration, STEP)
    return np.array([np.abs(motion.angle).max(), np.abs(motion.rate).max()])


def _free(name: str, taken: set[str]) -> str:
    return name if name not in taken else _free(f"{name}-again", taken)
