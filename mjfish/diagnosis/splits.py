"""How firmly a verdict is held: the same dataset, its runs divided anew into fitted and held-out ones.

A verdict that hangs on one run changes when that run changes sides. The splits share runs, so that how often something
comes is no probability: it says what these runs agree on.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from mjfish.data import Dataset, load_dataset
from mjfish.diagnosis.diagnosis import diagnose
from mjfish.diagnosis.held_out import Gain
from mjfish.diagnosis.result import Diagnosis, Verdict
from mjfish.errors import InputError, UnwritableError
from mjfish.execution.progress import Progress, part, silent
from mjfish.files.plain_data import plain
from mjfish.files.result import Result

#: Of ``splits.json``.
SCHEMA = 1
#: Of fewer runs only one is fitted.
_RUNS = 3


@dataclass(frozen=True)
class SplitMechanism:
    """A mechanism of the extended model of a split.

    Attributes:
        name: of the mechanism.
        level: how deep it is named, ``form`` or ``mechanism``; ``certain`` where rivals remain and all have it;
            ``not_named`` where it is only a part of what explains most.
    """

    name: str
    level: Literal["form", "mechanism", "certain", "not_named"]


@dataclass(frozen=True)
class Split:
    """One division of the runs, and its diagnosis.

    Attributes:
        fitted, held_out: names of the runs.
        declared: whether the dataset itself is divided so.
        verdict: of its diagnosis; None where none can be made.
        message: the verdict in one sentence, or why there is none.
        mechanisms: of its extended model; none where nothing is wrong.
        gain: of its extended model on its held-out runs; None where there is no such model.
    """

    fitted: tuple[str, ...]
    held_out: tuple[str, ...]
    declared: bool
    verdict: Verdict | None
    message: str
    mechanisms: tuple[SplitMechanism, ...] = ()
    gain: Gain | None = None

    @property
    def claims(self) -> frozenset[str]:
        """The mechanisms that are named or certain."""
        return frozenset(one.name for one in self.mechanisms if one.level != "not_named")

    def summary(self) -> str:
        """Return in words which mechanisms are named, certain, or explain most, or why there is no diagnosis."""
        if self.verdict is None:
            return f"not diagnosed: {self.message}"
        words: dict[str, list[str]] = {"": [], "certain: ": [], "not named: ": []}
        for one in self.mechanisms:
            before = {"certain": "certain: ", "not_named": "not named: "}.get(one.level, "")
            words[before].append(f"{one.name} (form)" if one.level == "form" else one.name)
        return "; ".join(before + ", ".join(names) for before, names in words.items() if names)


@dataclass(frozen=True)
class Share:
    """How often something came in the splits that could be diagnosed.

    Attributes:
        name: of the verdict or mechanism.
        count: splits in which it came; of a mechanism: in which it is named.
        share: of the splits that could be diagnosed.
        form: of these splits, those in which a mechanism is named with its form.
        certain: further splits in which rivals remain and all have the mechanism.
        not_named: further splits in which a mechanism is only a part of what explains most.
    """

    name: str
    count: int
    share: float
    form: int = 0
    certain: int = 0
    not_named: int = 0


@dataclass(frozen=True, eq=False, repr=False)
class Splits(Result):
    """The diagnosis of a dataset, and those of its splits.

    Attributes:
        diagnosis: of the dataset as it is divided.
        possible: number of divisions into as many fitted and held-out runs.
        splits: those that were drawn, in the order of their held-out runs.
    """

    diagnosis: Diagnosis
    possible: int
    splits: tuple[Split, ...]

    @property
    def diagnosed(self) -> tuple[Split, ...]:
        """The splits that could be diagnosed."""
        return tuple(split for split in self.splits if split.verdict is not None)

    @property
    def agreeing(self) -> int:
        """Number of splits with the verdict of the dataset and the mechanisms that are named or certain there."""
        own = _row(self.diagnosis, declared=True)
        return sum((split.verdict, split.claims) == (own.verdict, own.claims) for split in self.splits)

    @property
    def verdicts(self) -> tuple[Share, ...]:
        """How often each verdict came, the most frequent first."""
        counts = Counter(str(split.verdict) for split in self.diagnosed)
        return tuple(Share(name, count, count / len(self.diagnosed)) for name, count in counts.most_common())

    @property
    def mechanisms(self) -> tuple[Share, ...]:
        """How often each mechanism is named, the most frequent first."""
        levels = Counter((one.name, one.level) for split in self.diagnosed for one in split.mechanisms)
        found = []
        for name in dict.fromkeys(name for name, _ in levels):
            count = levels[name, "form"] + levels[name, "mechanism"]
            deep = (levels[name, "form"], levels[name, "certain"], levels[name, "not_named"])
            found.append(Share(name, count, count / len(self.diagnosed), *deep))
        return tuple(sorted(found, key=lambda share: (-share.count, -share.certain, -share.not_named)))

    def headline(self) -> str:
        """Return in words how often the verdict of the dataset, and each verdict, came."""
        own = _row(self.diagnosis, declared=True)
        certain = "" if own.verdict == "named" else "certain: "
        said = f"{own.verdict} ({certain}{', '.join(sorted(own.claims))})" if own.claims else f"{own.verdict}"
        own_too = ", the dataset's own among them" if any(split.declared for split in self.splits) else ""
        counts = [f"{one.name} {one.count}" for one in self.verdicts]
        if failed := len(self.splits) - len(self.diagnosed):
            counts.append(f"not diagnosed {failed}")
        return (
            f"The verdict {said} came in {self.agreeing} of {len(self.splits)} splits{own_too}. By verdict: "
            f"{', '.join(counts)}. Possible splits: {self.possible}."
        )

    def summary(self) -> str:
        """Return how often the verdict of the dataset, each verdict and each mechanism came, in at most ten lines."""
        known = len(self.diagnosed)
        lines = [f"{self.diagnosis.dataset.name}: {self.headline()}"]
        if failed := [split for split in self.splits if split.verdict is None]:
            lines.append(f"  {len(failed)} not diagnosed: {failed[0].message}")
        room = 10 - len(lines)
        lines += [
            f"  {one.name}: named in {one.count} of {known} ({one.form} with its form), certain in {one.certain} more, "
            f"a part of what explains most in {one.not_named} more"
            for one in self.mechanisms[:room]
        ]
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Return the splits as plain data, the content of ``splits.json``."""
        return {
            "schema": SCHEMA,
            "dataset": self.diagnosis.dataset.name,
            "verdict": self.diagnosis.verdict,
            "agreeing": self.agreeing,
            "diagnosed": len(self.diagnosed),
            "possible": self.possible,
            "verdicts": [{"name": one.name, "count": one.count, "share": one.share} for one in self.verdicts],
            "mechanisms": plain(self.mechanisms),
            "splits": plain(self.splits),
            "provenance": plain(self.diagnosis.provenance),
        }


def diagnose_splits(
    dataset: Dataset | str | Path,
    count: int,
    *,
    seed: int = 0,
    progress: Progress = silent,
    **options: Any,
) -> Splits:
    """Diagnose a dataset, and again with its runs divided anew so many times.

    Every split holds out as many runs as the dataset does; a third of them where the dataset holds out none. Stated
    noise, start values and bounds stay those of the dataset. Velocities are in m/s and rad/s.

    Args:
        dataset: three runs or more, or the folder of ``dataset.toml``.
        count: splits to draw, each at most once; where fewer are possible, all of them.
        seed: of the drawn splits, and of each diagnosis.
        progress: called with what is being done and the share that is done.
        options: the others of `mjfish.diagnose`: effects, jobs, executor, resume, limit.

    Returns:
        The diagnosis of the dataset, a row for each split, and how often each verdict and mechanism came. A split that
        cannot be diagnosed, because its fitted runs have too few numbers, is a row without a verdict.

    Raises:
        InputError: a count below one, fewer than three runs, or the dataset itself cannot be diagnosed.

    Example:
        >>> import mjfish
        >>> from mjfish.diagnosis import diagnose_splits
        >>> from mjfish.effects import find
        >>> truth, noise = {"servo_lag.time_constant": 0.03}, (0.006, 0.006, 0.04)
        >>> pool = mjfish.generate("pike", ["v1", "v5", "v3"], duration=4.0, values=truth, noise=noise)
        >>> found = diagnose_splits(pool, 3, effects={name: find(name) for name in ("servo_lag", "time_offset")})
        >>> [(split.held_out, split.verdict) for split in found.splits]
        [(('v1',), 'named'), (('v5',), 'named'), (('v3',), 'named')]
    """
    if count < 1:
        raise InputError(f"splits: found {count}, expected 1 or more; give the number of times to divide the runs")
    if not isinstance(dataset, Dataset):
        dataset = load_dataset(dataset)
    held_out, possible = _drawn(dataset, count, seed)
    own = _held_out(dataset)
    others = [held for held in held_out if held != own]
    total = 1 + len(others)

    def made(divided: Dataset, k: int, what: str) -> Diagnosis:
        told = part(lambda doing, done: progress(f"{what}: {doing}", done), k / total, 1.0 / total)
        return diagnose(divided, seed=seed, progress=told, **options)

    declared = made(dataset, 0, "as divided")
    rows = {own: _row(declared, declared=True)}
    for k, held in enumerate(others, 1):
        divided = _divided(dataset, held)
        try:
            rows[held] = _row(made(divided, k, f"split {k} of {len(others)}"), declared=False)
        except UnwritableError:  # of a folder of refits: no split could keep its own
            raise
        except InputError as error:
            fitted, out = (tuple(trial.name for trial in trials) for trials in divided.split())
            rows[held] = Split(fitted, out, declared=False, verdict=None, message=str(error))
    return Splits(declared, possible, tuple(rows[held] for held in held_out))


def _drawn(dataset: Dataset, count: int, seed: int) -> tuple[list[tuple[int, ...]], int]:
    """Return the places of the held-out runs of so many splits, sorted, none twice; and how many splits there are."""
    runs = len(dataset.trials)
    if runs < _RUNS:
        raise InputError(
            f"{dataset.name}: {runs} {'run' if runs == 1 else 'runs'}, expected {_RUNS} or more to divide anew; record "
            f"{_RUNS - runs} more"
        )
    size = len(_held_out(dataset) or _held_out(_divided(dataset, None)))
    possible, rng = math.comb(runs, size), np.random.default_rng(seed)
    found: set[tuple[int, ...]] = set()
    while len(found) < min(count, possible):
        found.add(tuple(sorted(int(place) for place in rng.choice(runs, size, replace=False))))
    return sorted(found), possible


def _held_out(dataset: Dataset) -> tuple[int, ...]:
    """Return the places of the runs that the dataset holds out."""
    held = dataset.split()[1]
    return tuple(place for place, trial in enumerate(dataset.trials) if trial in held)


def _divided(dataset: Dataset, held: Sequence[int] | None) -> Dataset:
    """Return the dataset with the runs in these places held out and the others fitted; None: without roles."""
    roles: list[Any] = [
        None if held is None else "held_out" if place in held else "fit" for place in range(len(dataset.trials))
    ]
    pairs = zip(dataset.trials, roles, strict=True)
    return replace(dataset, trials=tuple(replace(trial, role=role) for trial, role in pairs))


def _row(found: Diagnosis, *, declared: bool) -> Split:
    """Return what a table of splits tells of a diagnosis."""
    fitted, held = (tuple(trial.name for trial in trials) for trials in found.dataset.split())
    levels: dict[str, Any] = {one.name: one.level for one in found.mechanisms}
    for cause in found.best:
        levels.setdefault(found.effects[cause].mechanism, "certain" if cause in found.certain else "not_named")
    mechanisms = tuple(SplitMechanism(name, level) for name, level in levels.items())
    return Split(fitted, held, declared, found.verdict, found.message, mechanisms, found.gain)
