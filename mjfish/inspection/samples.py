"""Samples that noise cannot explain: outliers, stuck or clipped channels, frozen frames, rows that are there twice.

No model of the fish is needed. Each channel of a trial is interpolated from the samples beside it by the weights that
do so best in that trial (least squares with Huber weights): periodic swimming is predicted exactly, noise is not.

And measured joint angles that jump: at a start, or where the drive changes at once. They move faster than their samples
resolve. The motion between samples is a spline (`mjfish.drive.measured`). It is right where every sample follows from
those beside it. Each one is predicted by the polynomial through its six neighbours, three to either side; of a beat
with ten samples or more, that leaves less than the noise does. Where an angle or its rate jumps, the error stands far
above.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, signal, stats
from scipy.spatial import cKDTree

from mjfish.data import Trial, columns
from mjfish.data.validation import GAP, beats
from mjfish.fish.frames import CHANNELS, UNITS
from mjfish.inspection.finding import Finding
from mjfish.numerics.arrays import BoolArray, FloatArray, robust_sigma

#: Neighbours to either side: as many as an odd and an even harmonic or two need, twice.
REACH = 5
_ROUNDS = 5
#: After a start or a step of the drive, beats that are left out.
_BEATS = 2.5
_HUBER = 1.5
#: Repeated values, or a far sample, that are less probable than this are a finding.
_LEVEL = 1e-4
#: Samples at an extreme value that make a clipped channel, and how many times more than at so many next values.
_CLIPPED, _PILE, _NEXT = 4, 4.0, 5
#: Blocks of so many rows in a row, and how many of them two trials may share to the last bit by chance: rows alone are
#: shared by runs of one drive that were rounded.
_BLOCK, _SHARED = 4, 3
#: Data whose noise is below this share of their range in every channel are simulated, or smoothed until none is left.
_SILENT = 2e-4
#: A row is loud beyond this many sigma in a channel; noise about two such rows is alike within this distance, in sigma.
_LOUD, _ALIKE = 2.2, 2.0
#: Two repeats differ by sqrt(2) sigma; a copy that was rounded or resaved, by less than this many sigma.
_NEAR = 0.3
#: Least share of the shorter of the two that must overlap.
_OVERLAP = 0.25
#: Beyond this many sigma a sample is far out.
FAR = 6.0
#: An outlier smaller than this share of the channel's range is not worth a word.
_SMALL = 0.05
#: Share of far samples from which the tails are heavy: of normal noise there are 2e-9.
_HEAVY = 3e-4
#: Neighbours of a joint angle to either side, the degree of the polynomial and one, halved.
_JOINT_REACH = 3
_OFFSETS = np.array([k for k in range(-_JOINT_REACH, _JOINT_REACH + 1) if k != 0])
#: A jump leaves more than this many sigma, of which normal noise leaves none, and this share of the joint's range.
_JUMP, _SMALL_JUMP = 7.0, 0.01
#: Rows beside a jump that its angles reach.
_BESIDE = 2
#: Fewest samples of which a standard deviation is taken.
_FEWEST_ANGLES = 8 * _JOINT_REACH
#: Where it happens oftener than once in so many beats it belongs to the beat, and no cut removes it.
_BEATS_A_JUMP = 2.0


@dataclass(frozen=True)
class Jump:
    """Where a measured joint moves faster than its samples resolve.

    Attributes:
        first, last: rows that do not follow from those beside them.
        joint: where that is clearest, from 0.
        error: of the worst of these samples [rad].
        sigma: how many standard deviations of the trial's other samples that is.
    """

    first: int
    last: int
    joint: int
    error: float
    sigma: float


def jumps(trial: Trial) -> list[Jump]:
    """Return the jumps of measured joint angles; none where they belong to every beat."""
    angle = trial.joint_angle
    if angle is None or trial.commanded or len(angle) < _FEWEST_ANGLES:
        return []
    error = np.abs(_left_out(trial.time, angle))
    sigma = robust_sigma(error) + 1e-300
    rows = np.flatnonzero(np.any(error > np.maximum(_JUMP * sigma, _SMALL_JUMP * np.ptp(angle, axis=0)), axis=1))
    found = []
    for cluster in filter(len, np.split(rows, np.flatnonzero(np.diff(rows) > 2 * _JOINT_REACH) + 1)):
        worst, joint = np.unravel_index(np.argmax(error[cluster] / sigma), (len(cluster), angle.shape[1]))
        size = float(error[cluster[worst], joint])
        first, last = (cluster[[0, -1]] + _JOINT_REACH).tolist()
        found.append(Jump(first, last, int(joint), size, size / float(sigma[joint])))
    count = float(np.ptp(trial.time)) * min(beats(trial), default=0.0)
    return found if len(found) <= max(count / _BEATS_A_JUMP, 1.0) else []


def unresolved(trial: Trial) -> Iterator[Finding]:
    """Yield where measured joint angles jump: the motion between the samples, and the force on them, are unknown."""
    found = jumps(trial)
    if not found:
        return
    worst = max(found, key=lambda jump: jump.sigma)
    time, joint = trial.time, columns.joint(worst.joint + 1)
    when = " and ".join(f"{0.5 * (time[jump.first] + time[jump.last]):.3g} s" for jump in found)
    yield Finding(
        "joints-unresolved",
        "suspect",
        f"trial '{trial.name}', {joint}, near {when}",
        f"an angle is {worst.error:.2g} rad ({worst.sigma:.0f} sigma) off the line through its neighbours: the joint "
        f"moves faster than a sample every {trial.step:.3g} s resolves, or the sample was misread",
        "angles that follow from the samples beside them",
        f"cut the run there: keep {_kept(trial, found)}; or record the joint angles faster, or give the drive in place "
        "of the angles",
        trials=(trial.name,),
        channels=(joint,),
    )


def _kept(trial: Trial, found: Sequence[Jump]) -> str:
    """Return the times of the rows between the jumps, where they last a beat."""
    time = trial.time
    least = 1.0 / min(beats(trial), default=np.inf)
    # The beat after a jump is left out: the start of a run is fitted, and must not lie on angles that are in doubt.
    after = max(_BESIDE, round(least / trial.step))
    starts = [0, *(min(jump.last + after, len(time) - 1) for jump in found)]
    ends = [*(max(jump.first - _BESIDE, 0) for jump in found), len(time) - 1]
    parts = [(float(time[a]), float(time[b])) for a, b in zip(starts, ends, strict=True)]
    long = [f"{a:.4g} to {b:.4g} s" for a, b in parts if b - a > least]
    more = ", each as a run of its own" if len(long) > 1 else ""
    return (
        f"its rows from {' and from '.join(long)}{more}" if long else "the parts before and after, if they last a beat"
    )


def _left_out(time: FloatArray, angle: FloatArray) -> FloatArray:
    """Return samples (n - 6, joints) less the polynomial through their six neighbours."""
    rows = np.arange(_JOINT_REACH, len(time) - _JOINT_REACH)
    near = time[rows[:, None] + _OFFSETS]
    weights = np.ones_like(near)
    for m, q in permutations(range(len(_OFFSETS)), 2):
        weights[:, m] *= (time[rows] - near[:, q]) / (near[:, m] - near[:, q])
    return np.asarray(angle[rows] - np.einsum("km,kmj->kj", weights, angle[rows[:, None] + _OFFSETS]))


@dataclass(frozen=True, eq=False)
class Interpolated:
    """Misfit of the samples of one trial to a smooth line.

    Attributes:
        trial: the trial.
        rows: (m,) samples that have all their neighbours.
        misfit: (m, 3) sample minus line; of white noise sigma, it has sigma sqrt(1 + |weights|^2).
        sigma: (3,) robust standard deviation of `misfit`.
        noise: (3,) the white noise that explains it.
    """

    trial: Trial
    rows: NDArray[np.intp]
    misfit: FloatArray
    sigma: FloatArray
    noise: FloatArray


def interpolated(trial: Trial) -> Interpolated | None:
    """Interpolate every sample from its neighbours; None where too few samples have all of theirs."""
    time = trial.time
    torn = np.diff(time) > GAP * trial.step
    for segment in trial.drive:  # what the fish does in its first beats is not periodic
        settling = segment.start + _BEATS * 2.0 * np.pi / segment.omega
        torn |= (time[1:] >= segment.start - trial.step) & (time[:-1] <= settling)
    for jump in jumps(trial):  # the velocity jumps with the joints
        torn[max(jump.first - 1, 0) : jump.last + 1] = True
    before = np.concatenate([[0], np.cumsum(torn)])
    rows = np.arange(REACH, len(time) - REACH)
    rows = rows[before[rows + REACH] == before[rows - REACH]]
    if len(rows) < 8 * REACH:
        return None
    offsets = np.array([k for k in range(-REACH, REACH + 1) if k != 0])
    fits = [
        huber_fit(np.column_stack([values[rows[:, None] + offsets], np.ones(len(rows))]), values[rows])
        for values in (trial.velocity - np.median(trial.velocity, axis=0)).T
    ]
    misfit = np.column_stack([left for left, _ in fits])
    sigma = robust_sigma(misfit) + 1e-300
    gain = np.array([1.0 + weights[:-1] @ weights[:-1] for _, weights in fits])
    return Interpolated(trial, rows, misfit, sigma, sigma / np.sqrt(gain))


def huber_fit(design: FloatArray, target: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return residuals and coefficients of a Huber fit."""
    weight = np.ones(len(target))
    for _ in range(_ROUNDS):
        root = np.sqrt(weight)
        coefficients = np.linalg.lstsq(design * root[:, None], target * root)[0]
        residual = target - design @ coefficients
        scale = _HUBER * float(robust_sigma(residual)) + 1e-300
        weight = np.minimum(scale / np.maximum(np.abs(residual), 1e-300), 1.0)
    return np.asarray(residual), np.asarray(coefficients)


def stuck(trial: Trial) -> Iterator[Finding]:
    """Find rows that repeat the row before, and channels that do, or that pile up at their largest value."""
    same = np.diff(trial.velocity, axis=0) == 0.0
    moving = np.any(trial.velocity[1:] != 0.0, axis=1)
    frozen = np.all(same, axis=1) & moving
    # How often single values repeat by chance, as they do where they were rounded.
    repeating = np.sum(same[~frozen], axis=0) / max(np.count_nonzero(~frozen), 1)
    if frozen.any() and len(same) * np.prod(repeating) < _LEVEL:
        rows = np.flatnonzero(frozen) + 1
        yield Finding(
            "stuck-frozen",
            "suspect",
            f"trial '{trial.name}', row {rows[0] + 1} ({trial.time[rows[0]]:.3f} s)"
            + (f" and {len(rows) - 1} more" if len(rows) > 1 else ""),
            ("1 row repeats" if len(rows) == 1 else f"{len(rows)} rows repeat")
            + " the row before in all channels: frozen frames",
            "rows that differ by their noise at least",
            without_rows(trial),
            trials=(trial.name,),
        )
    for channel, name in enumerate(CHANNELS):
        if np.ptp(trial.velocity[:, channel]) == 0.0:
            yield Finding(
                "stuck-silent",
                "blocks",
                f"trial '{trial.name}', {name}",
                f"every value is {trial.velocity[0, channel] + 0.0:.4g} {UNITS[name]}: the channel was not recorded",
                "a channel that moves with the fish",
                "give the recorded channel, or leave the trial out",
                trials=(trial.name,),
                channels=(name,),
            )
        elif found := _clipped(trial, channel) or _held(trial, channel, same[:, channel] & ~frozen & moving):
            yield found


def without_rows(trial: Trial) -> str:
    """Return how to leave rows out: joint angles that were recorded are not known where rows are missing."""
    gaps = "say gaps = true in the trial's entry"
    cut = "cut the run there into two trials, for between recorded joint angles no row may miss"
    return f"remove these rows and {gaps if trial.joint_angle is None else cut}"


def _held(trial: Trial, channel: int, same: BoolArray) -> Finding | None:
    """Find one channel that keeps its value while the others move, longer than rounding explains."""
    runs, _ = ndimage.label(same)
    lengths = np.bincount(runs.ravel(), minlength=2)[1:]
    inside, length = runs == 1 + np.argmax(lengths), int(lengths.max())
    if length < 3 or len(same) * max(float(np.mean(same[~inside])), 1e-12) ** length > _LEVEL:
        return None
    start, name = int(np.argmax(inside)), CHANNELS[channel]
    return Finding(
        "stuck-held",
        "suspect",
        f"trial '{trial.name}', {name}, rows {start + 1} to {start + length + 1} ({trial.time[start]:.3f} s)",
        f"the value stays at {trial.velocity[start, channel]:.4g} {UNITS[name]} while the other channels move",
        "a value that changes with every row",
        f"{without_rows(trial)}; or see why the channel was stuck",
        trials=(trial.name,),
        channels=(name,),
    )


def _clipped(trial: Trial, channel: int) -> Finding | None:
    """Find values that pile up at the largest or the smallest one."""
    values, name = trial.velocity[:, channel], CHANNELS[channel]
    for sign, word in ((1.0, "above"), (-1.0, "below")):
        levels, counts = np.unique(sign * values, return_counts=True)
        if len(levels) <= _NEXT or levels[-1] == 0.0:
            continue
        piled, apart = int(counts[-1]), np.diff(np.flatnonzero(sign * values == levels[-1])) > 1
        if piled >= max(_CLIPPED, _PILE * counts[-1 - _NEXT : -1].max()) and apart.any():  # at one place it is stuck
            return Finding(
                "stuck-clipped",
                "suspect",
                f"trial '{trial.name}', {name}",
                f"{piled} samples are exactly {sign * levels[-1]:.4g} {UNITS[name]} and none is {word}: the sensor is "
                "at its limit",
                "peaks that differ",
                f"record with a wider range of the sensor; or {without_rows(trial)}",
                trials=(trial.name,),
                channels=(name,),
            )
    return None


def copies(
    trials: Sequence[Trial], held: Sequence[str], sigma: FloatArray, lines: Sequence[Interpolated]
) -> Iterator[Finding]:
    """Find pairs of trials that share rows, or that are closer than their own noise.

    Args:
        trials: of the dataset.
        held: names of those held out.
        sigma: (3,) noise that a smooth line through single recordings leaves (`interpolated`).
        lines: those lines, of trials that have one.
    """
    if not trials:
        return
    silent = bool(np.all(sigma < _SILENT * np.ptp(np.concatenate([trial.velocity for trial in trials]), axis=0)))
    sharing = _shared_blocks(trials)
    near = set() if silent else _recurring(trials, lines)
    for i, j in sorted(near | sharing.keys()):
        a, b, exact = trials[i], trials[j], sharing[i, j] >= _SHARED
        if not exact and (silent or not _close(a, b, sigma)):
            continue
        shared, leak = sharing[i, j] + _BLOCK - 1, (a.name in held) != (b.name in held)
        share = min(shared / min(len(a.time), len(b.time)), 1.0)
        what = f"share {shared} rows ({share:.0%}) exactly" if exact else "are the same but for less than their noise"
        consequence = "one is fitted and the other held out, so that the gain is no gain" if leak else "it counts twice"
        yield Finding(
            "copies-without-noise" if silent else "copies-leak" if leak else "copies-twice",
            "remark" if silent else "blocks" if leak else "suspect",
            f"trials '{a.name}' and '{b.name}'",
            f"{what}, in data without noise" if silent else f"they {what}; {consequence}",
            "noise, that never repeats itself" if silent else "recordings of their own, with noise of their own",
            "simulated data: nothing to do; measured data: remove one of the two"
            if silent
            else "remove one of the two, or cut the part that they share",
            trials=(a.name, b.name),
        )


def _shared_blocks(trials: Sequence[Trial]) -> Counter[tuple[int, int]]:
    """Return how many blocks, four rows that follow each other, pairs of trials have in common, but those at rest."""
    having: dict[int, list[int]] = {}
    for i, trial in enumerate(trials):
        values = trial.velocity + 0.0  # minus zero is zero
        moving = np.any(values != 0.0, axis=1)
        starts = range(len(values) - _BLOCK + 1)
        for block in {hash(values[k : k + _BLOCK].tobytes()) for k in starts if moving[k : k + _BLOCK].all()}:
            having.setdefault(block, []).append(i)
    return Counter(pair for own in having.values() for pair in combinations(own, 2))


def _recurring(trials: Sequence[Trial], lines: Sequence[Interpolated]) -> set[tuple[int, int]]:
    """Return the pairs of trials in which the same noise recurs, so often and so far apart that it may be no chance.

    Three rows with a loud one between are looked up among all others in a tree: to compare every trial with every other
    takes the square of their number. Of a trial without a line, that is a short one, all pairs are returned.
    """
    known = {id(line.trial): line for line in lines}
    short = [i for i, trial in enumerate(trials) if id(trial) not in known]
    found = {(min(i, j), max(i, j)) for i in short for j in range(len(trials)) if j != i}
    noise, places = [np.zeros((0, 9))], [np.zeros((0, 2), dtype=np.intp)]
    for i in sorted({*range(len(trials))} - {*short}):
        line = known[id(trials[i])]
        scaled = line.misfit / line.sigma
        loud = 1 + np.flatnonzero(np.any(np.abs(scaled[1:-1]) > _LOUD, axis=1))
        loud = loud[line.rows[loud + 1] - line.rows[loud - 1] == 2]
        noise.append(scaled[loud[:, None] + np.arange(-1, 2)].reshape(-1, 9))
        places.append(np.column_stack([np.full(len(loud), i), line.rows[loud]]))
    pairs = cKDTree(np.concatenate(noise)).query_pairs(_ALIKE, output_type="ndarray")  # each in order
    (i, first), (j, second) = np.concatenate(places)[pairs.T].swapaxes(1, 2)
    seen, counts = np.unique(np.column_stack([i, j, second - first])[i != j], axis=0, return_counts=True)
    return found | {(int(i), int(j)) for i, j, _ in seen[counts >= _SHARED]}


def _close(a: Trial, b: Trial, sigma: FloatArray) -> bool:
    """Whether two recordings, one shifted to where they agree best, differ by less than noise can.

    That is where the mean square of their difference is least; sum (a - b)^2 over what overlaps = sums of squares,
    which grow with the overlap, less twice the correlation.
    """
    first, second = a.velocity / sigma, b.velocity / sigma
    n, m = len(first), len(second)
    lags = signal.correlation_lags(n, m)
    correlation = sum(signal.correlate(*channels, method="fft") for channels in zip(first.T, second.T, strict=True))
    start, stop = np.maximum(lags, 0), np.minimum(lags + m, n)
    squares, others = (np.concatenate([[0.0], np.cumsum(np.sum(x**2, axis=1))]) for x in (first, second))
    power = squares[stop] - squares[start] + others[stop - lags] - others[start - lags]
    enough = stop - start >= _OVERLAP * min(n, m)
    best = int(np.argmin(np.where(enough, (power - 2.0 * correlation) / (stop - start), np.inf)))
    left = first[start[best] : stop[best]] - second[start[best] - lags[best] : stop[best] - lags[best]]
    return bool(np.median(np.abs(left), axis=0).max() < _NEAR)


def outliers(found: Sequence[Interpolated]) -> Iterator[Finding]:
    """Judge the samples of all trials against the noise they are in.

    The misfits of all trials, in units of their sigma, are described by a Student t. Its degrees of freedom follow from
    the 97.5 % point of the misfits, which a few outliers do not move. A sample that this t does not reach in so many
    samples is an outlier.
    """
    for channel, name in enumerate(CHANNELS if found else ()):
        scaled = [line.misfit[:, channel] / line.sigma[channel] for line in found]
        every = np.concatenate(scaled)
        degrees_of_freedom, spread = _student(every)
        limit = max(float(stats.t.isf(0.5 * _LEVEL / len(every), degrees_of_freedom)) * spread, FAR)
        for line, values in zip(found, scaled, strict=True):
            size = np.abs(line.misfit[:, channel])
            out = np.flatnonzero((np.abs(values) > limit) & (size > _SMALL * np.ptp(line.trial.velocity[:, channel])))
            # Beside an outlier the line itself is bent.
            peaks = [int(k) for k in out if size[k] >= size[np.abs(line.rows - line.rows[k]) <= 3].max()]
            if peaks:
                worst = max(peaks, key=lambda k: abs(values[k]))
                row, others = line.rows[worst], f" and {len(peaks) - 1} more" if len(peaks) > 1 else ""
                yield Finding(
                    "outliers-samples",
                    "suspect",
                    f"trial '{line.trial.name}', {name}, row {row + 1} ({line.trial.time[row]:.3f} s){others}",
                    f"{line.trial.velocity[row, channel]:.4g} {UNITS[name]} is {abs(values[worst]):.0f} sigma off the "
                    "line through its neighbours",
                    f"samples within what the noise of the other {len(values) - len(peaks)} reaches",
                    f"correct them at the source; or {without_rows(line.trial)}",
                    trials=(line.trial.name,),
                    channels=(name,),
                )
        share = float(np.mean(np.abs(every) > FAR))
        if share > _HEAVY and degrees_of_freedom < 10.0:
            yield Finding(
                "outliers-heavy-tails",
                "remark",
                f"channel {name}",
                f"the noise has heavy tails: {share:.2%} of the samples are beyond {FAR:g} sigma, as a Student t of "
                f"{degrees_of_freedom:.1f} degrees of freedom has them",
                "normal noise, with none",
                "p values are then a little too small and weak causes harder to see; look for lost markers",
                channels=(name,),
            )


def _student(values: FloatArray) -> tuple[float, float]:
    """Return degrees of freedom and scale of the Student t with the median and the 97.5 % point of |values|."""
    half, high = np.quantile(np.abs(values), [0.5, 0.975])
    grid = np.concatenate([np.arange(1.0, 5.0, 0.25), np.arange(5.0, 31.0), [100.0]])
    ratios = stats.t.ppf(0.9875, grid) / stats.t.ppf(0.75, grid)
    degrees_of_freedom = float(np.interp(-high / max(half, 1e-300), -ratios, grid))
    return degrees_of_freedom, float(half / stats.t.ppf(0.75, degrees_of_freedom))
