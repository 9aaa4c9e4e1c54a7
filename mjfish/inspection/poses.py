"""Places and headings of a camera, before any fit: axes, zero and unit, exchanged markers, whose heading it is.

Of every beat the track and the heading h have a mean and a swing, which is what a line leaves of them. Means need no
model: a fish swims where its head points. With d the way from the mean place of a beat to that of the next, a complex
number, and h their mean heading,

    R+ = sum d exp(-i h) / sum |d|        R- = sum d exp(i h) / sum |d|

|R+| is near 1, whatever the zero of the heading, which is its angle; |R-| is, where track or heading are mirrored.
Swings are held against the nominal simulation, for joints force the head to recoil whatever the coefficients are. A
heading is mirrored (s = -1), or is that of link k, where this explains it and what it should be does not,

    cost(s, k) = min over shift t', amplitude a of  mean over runs of  |s h(t) - a q_k(t + t')|^2 / |h|^2

with q_k the simulated swing of link k.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mjfish.data import Dataset, Sensor, Trial
from mjfish.data.trial import rows_of
from mjfish.data.validation import beats
from mjfish.fish import Fish
from mjfish.inspection.finding import Finding
from mjfish.inspection.samples import REACH, huber_fit
from mjfish.model import Model
from mjfish.numerics.arrays import FloatArray, robust_sigma

_SEEN = ("position", "heading")
#: Beats of a run that are looked at, fewest of them, and samples and share of them that a beat must have.
_MOST, _BEATS, _SAMPLES, _SHARE = 100, 4, 6, 0.7
#: Least way from beat to beat [body lengths], measured and simulated, and fewest of such ways.
_MOVED, _WAYS = 0.05, 8
#: |R| of an angle that is constant, and by how much less that of another is.
_CONSTANT, _LESS = 0.95, 0.08
#: Fewest runs, or a run that turns by so much [rad], in which a mirrored angle is no chance.
_RUNS, _TURNS = 3, 0.5
#: The zero of a heading is another where heading and course differ by more, and, where all runs head one way, by a
#: quarter or half a turn to so much [rad].
_OFF, _QUARTER = math.radians(45.0), math.radians(20.0)
#: Shifts of the clock that are tried [s], of measured joints and of commands: late servos are not mirrored ones.
_SHIFTS, _LATE = 0.01 * np.arange(-6.0, 7.0), 0.01 * np.arange(-25.0, 7.0)
#: Amplitudes a; costs of what explains a swing, and of what does not.
_SMALLEST, _LARGEST, _EXPLAINS, _FOREIGN = 0.6, 1.7, 0.1, 0.3
#: A run turns where it does so by this from beat to beat [rad]; how turns must go with the simulated ones, or against.
_TURN, _SURE = 0.04, 0.5
#: Sizes, measured over simulated, of lengths in another unit: what they are, and the option; factor to be near them.
_LENGTHS = {
    1000.0: ("mm taken for m", "--length-unit mm"), 100.0: ("cm taken for m", "--length-unit cm"),
    0.01: ("m taken for cm", "--length-unit m"), 0.001: ("m taken for mm", "--length-unit m"),
}  # fmt: skip
_NEAR = 3.0
#: The same of a heading: degrees taken for radians, whose jumps of a turn hide a part of it, but which then swings
#: wildly [rad], and the reverse, which must go with the simulated swing by so much.
_DEGREES, _WILD, _RADIANS, _ALIKE = 12.0, 0.6, math.pi / 180.0, 0.8
#: A step between samples is a jump where it is so many times as far off what those beside it predict as the noise
#: and a share of the swing of so many samples beside it; of the swing the largest twentieth does not count. Fewest
#: steps that are looked at. None of 840 simulated sensors jumps (2 to 5 Hz at 20 to 50 Hz, rests, starts, turns, 0 to 3
#: mm of noise), and of 3456 frames of two datasets that were put off by 3 cm one is missed. Exchanged ends turn a
#: heading by half a turn, to so many rad.
_FAR, _PREDICTED, _NEARBY, _COMMON, _FEWEST, _HALF = 8.0, 0.2, 31, 0.95, 80, 0.4
#: Keeps quotients finite.
_DUST = 1e-30


def pose_findings(dataset: Dataset) -> Iterator[Finding]:
    """Yield what cannot be right of the places and headings that sensors measured.

    A weak or late servo, a current, noise or another drag make no finding.
    """
    yield from _missing(dataset)
    seen = [(trial, sensor) for trial in dataset.trials for sensor in trial.sensors if sensor.kind in _SEEN]
    jumps = [found for trial, sensor in seen if (found := _jumps(trial, sensor))]
    torn = {name for found in jumps if found.severity == "blocks" for name in found.trials}
    shifts = _SHIFTS if all(trial.joints_measured for trial in dataset.trials) else _LATE
    model = Model(dataset.fish)
    whole = (_run(trial, model, shifts) for trial in dataset.trials if trial.name not in torn)
    runs = [run for run in whole if run is not None]
    # Jumps and axes show only where the units are right.
    units = [*_units(runs)] if runs else []
    yield from units or jumps
    if runs and not units:
        yield from _axes(runs, dataset.fish)


def _jumps(trial: Trial, sensor: Sensor) -> Finding | None:
    """Find places that jump as those of exchanged markers do, and headings that jump by half a turn.

    A step d_t of a smooth motion follows from those beside it, by weights w that are fitted to the run, robustly. With
    sigma the spread of what these leave, and s the rms of the steps near t about their mean,

        |d_t - sum_k w_k d_(t+k)|  >  8 sqrt(sigma^2 + (s / 5)^2)

    is a jump. The largest is taken out before the next is looked for, since the steps beside it do not follow either.
    """
    steps = np.diff(sensor.values, axis=0) / np.diff(rows_of(sensor.time))[:, None]
    if len(steps) < _FEWEST:
        return None
    raw, inner = steps.copy(), slice(REACH, -REACH)
    near = np.lib.stride_tricks.sliding_window_view(steps, 2 * REACH + 1, axis=0)  # changes with `steps`
    fits = (huber_fit(np.delete(own, REACH, axis=1), own[:, REACH]) for own in near.swapaxes(0, 1))
    kernels = np.array([np.insert(-weights, REACH, 1.0) for _, weights in fits])
    left = np.einsum("tck,ck->tc", near, kernels)
    swing = np.linalg.norm(steps - ndimage.uniform_filter1d(steps, _NEARBY, axis=0), axis=1)
    common = np.minimum(swing, np.quantile(swing, _COMMON))  # jumps are no swing
    nearby = np.sqrt(ndimage.uniform_filter1d(common**2, _NEARBY))[inner]
    least = _FAR * np.hypot(robust_sigma(left).max(), _PREDICTED * nearby) + _DUST
    size = np.linalg.norm(left, axis=1) / least
    for _ in steps:
        if size[worst := int(np.argmax(size))] <= 1.0:
            break
        steps[REACH + worst] -= left[worst]
        moved = np.s_[max(worst - REACH, 0) : worst + REACH + 1]
        left[moved] = np.einsum("tck,ck->tc", near[moved], kernels)
        size[moved] = np.linalg.norm(left[moved], axis=1) / least[moved]
    size = np.linalg.norm(raw - steps, axis=1)
    rows = REACH + np.flatnonzero((size[inner] > least) & (np.diff(sensor.time)[inner] < 1.5 * sensor.step))
    if not len(rows):
        return None
    half = sensor.kind == "heading" and bool(np.median(np.abs(size[rows] - math.pi)) < _HALF)
    why = ": half a turn, as of a line without a front, or of exchanged ends" if half else ", as exchanged markers do"
    remedy = "track these frames again, or leave their cells empty"
    return Finding(
        "poses-half-turns" if half else "poses-jumps",
        "blocks" if half else "suspect",
        f"trial '{trial.name}', {sensor.name}, row {rows[0] + 2} ({sensor.time[rows[0] + 1]:.3f} s)"
        + (f" and {len(rows) - 1} more" if len(rows) > 1 else ""),
        f"it jumps by {np.median(size[rows]):.3g} {sensor.units[0]} from a sample to the next{why}",
        "a motion that goes on from sample to sample",
        f"give the direction from tail to nose, or {remedy}" if half else remedy,
        trials=(trial.name,),
    )


def _missing(dataset: Dataset) -> Iterator[Finding]:
    """Say how many samples of places and headings are missing in a run, and what was left out when they were read."""
    for trial in dataset.trials:
        seen = [sensor for sensor in trial.sensors if sensor.kind in _SEEN and (sensor.remarks or _gaps(sensor))]
        if seen:
            gaps = {sensor.name: _gaps(sensor) for sensor in seen}
            each = {*gaps.values()} if len({*gaps.values()}) == 1 else [f"{n}: {gap}" for n, gap in gaps.items() if gap]
            steps = dict.fromkeys(f"{sensor.step:.3g} s" for sensor in seen)
            yield Finding(
                "poses-missing",
                "remark",
                f"trial '{trial.name}', {' and '.join(gaps)}",
                "; ".join(filter(None, [*(remark for sensor in seen for remark in sensor.remarks), *each])),
                f"a sample every {' or '.join(steps)}",
                "nothing, where they are lost: a fit goes by the others",
                trials=(trial.name,),
                channels=tuple(gaps),
            )


def _gaps(sensor: Sensor) -> str:
    """Return how many samples of a sensor are missing, in words; nothing where none is."""
    frames, longest = int(rows_of(sensor.time)[-1]) + 1, np.diff(sensor.time).max()
    lost = frames - len(sensor.time)
    return f"{lost} of {frames} samples are missing, the longest gap is {longest:.3g} s" if lost else ""


class _Run(NamedTuple):
    """One run, beat by beat, measured and simulated.

    Attributes:
        way: (b,) from the mean place of a beat to that of the next, complex [m].
        heading: (b,) mean of the two beats [rad].
        turns: (b, 2) change of the mean heading from beat to beat, measured and simulated [rad].
        sizes: (3,) of the swings of place and heading, and of the way, measured over simulated.
        swing: rms of the heading's [rad].
        products, squares: (shifts, links) sums of h q_k and of q_k^2, over that of h^2.
        phased: whether it is known when the joints beat, by the heading's clock, so that these two mean something.
        ahead: whether the simulated fish swims where its head points.
    """

    way: NDArray[np.complex128]
    heading: FloatArray
    turns: FloatArray
    sizes: FloatArray
    swing: float
    products: FloatArray
    squares: FloatArray
    phased: bool
    ahead: bool


def _run(trial: Trial, model: Model, shifts: FloatArray) -> _Run | None:
    """Compare a run with its nominal simulation; None where it has no place, no heading, no beat, or is too short."""
    kinds = {sensor.kind: sensor for sensor in reversed(trial.sensors)}
    frequency = min(beats(trial), default=0.0)
    if not set(_SEEN) <= set(kinds) or not frequency:
        return None
    seen = [kinds["position"], kinds["heading"]]
    first, last = max(float(s.time[0]) for s in seen), min(float(s.time[-1]) for s in seen)
    edges = first + np.arange(min(int((last - first) * frequency), _MOST) + 1) / frequency
    if len(edges) <= _BEATS:
        return None
    rows = trial.time <= edges[-1] + 1.0 / frequency
    short = replace(
        trial, time=trial.time[rows], velocity=trial.velocity[rows], pose=None, errors=None,
        joint_angle=None if trial.joint_angle is None else trial.joint_angle[rows],
        sensors=tuple(sensor.selected(sensor.time <= edges[-1], "later") for sensor in seen),
    )  # fmt: skip
    simulated, joints = model.predict(short, model.values()), model.prepare(short, model.values()).motion
    if simulated.status != "ok":
        return None
    place, heading = (
        [_by_beat(sensor.time, values, edges) for values in (sensor.values, read)]
        for sensor, read in zip(short.sensors, simulated.sensors, strict=True)
    )
    ways = [np.diff(mean[:, 0] + 1j * mean[:, 1]) for mean, _ in place]
    means = np.column_stack([mean for mean, _ in heading])
    between = 0.5 * (means[1:] + means[:-1])
    ahead, there = float(np.nansum(np.real(ways[1] * np.exp(-1j * between[:, 1])))), np.isfinite(ways[1])
    swing, swings = heading[0][1], []
    for by in shifts:
        at = np.clip(short.sensors[1].time + by, joints.time[0], joints.time[-1])
        links = np.column_stack([simulated.rollout.at(at)[:, 5], joints.angle_at(at)])
        swings.append(_by_beat(short.sensors[1].time, np.cumsum(links, axis=1), edges)[1])
    pairs = ([swing for _, swing in place], [swing for _, swing in heading], ways)
    power = np.nansum(swing**2) + _DUST
    return _Run(
        way=ways[0],
        heading=between[:, 0],
        turns=np.diff(means, axis=0),
        sizes=np.sqrt([np.nansum(np.abs(own) ** 2) / (np.nansum(np.abs(other) ** 2) + _DUST) for own, other in pairs]),
        swing=float(np.sqrt(np.nanmean(swing**2))) if power > _DUST else 0.0,
        products=np.nansum(swing * swings, axis=1) / power,
        squares=np.nansum(np.square(swings), axis=1) / power + _DUST,
        phased=(trial.wave is None or not trial.wave.free) and not seen[1].free_clock,
        ahead=ahead > max(_CONSTANT * float(np.sum(np.abs(ways[1][there]))), _MOVED * model.fish.length * there.sum()),
    )


def _by_beat(time: FloatArray, values: FloatArray, edges: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the mean (b, c) of every beat and the swing (m, c) of samples (m, c), NaN where a beat has few of them."""
    fewest = max(_SHARE * (edges[1] - edges[0]) / float(np.median(np.diff(time))), _SAMPLES)
    mean, swing = np.full((len(edges) - 1, values.shape[1]), np.nan), np.full_like(values, np.nan)
    for k, (a, b) in enumerate(pairwise(np.searchsorted(time, edges))):
        if b - a >= fewest:
            at = time[a:b] - time[a:b].mean()
            mean[k] = values[a:b].mean(axis=0)
            swing[a:b] = values[a:b] - mean[k] - np.outer(at, at @ values[a:b]) / (at @ at)
    return mean, swing


def _units(runs: Sequence[_Run]) -> Iterator[Finding]:
    """Say which of place and heading is in another unit: swing and way are both as much too large or too small."""
    place, turn, way = np.median([run.sizes for run in runs], axis=0)
    for factor, (what, option) in _LENGTHS.items():
        if max(abs(math.log(size / factor)) for size in (place + _DUST, way + _DUST)) < math.log(_NEAR):
            yield _everywhere(
                "poses-unit",
                "position",
                f"the fish swings and swims {way:.3g} times as far as simulated: {what}",
                "sizes as simulated",
                f"import again with {option}",
            )
    alike = [float(np.max(run.products[:, 0] / np.sqrt(run.squares[:, 0]))) for run in runs if run.phased]
    small = abs(math.log((turn + _DUST) / _RADIANS)) < math.log(_NEAR) and bool(alike) and np.median(alike) > _ALIKE
    if small or (turn > _DEGREES and np.median([run.swing for run in runs]) > _WILD):
        what = "radians taken for degrees" if small else "degrees taken for radians"
        yield _everywhere(
            "poses-unit",
            "heading",
            f"the heading swings {turn:.3g} times as far as simulated: {what}",
            "sizes as simulated",
            f"import again with --angle-unit {'rad' if small else 'deg'}, and --joint-unit for the joints if they are "
            "in another",
        )


def _axes(runs: Sequence[_Run], fish: Fish) -> Iterator[Finding]:
    """Say that track or heading are mirrored, that the heading has another zero, or is that of another link."""
    seen = [run for run in runs if run.ahead]
    way, heading = (np.concatenate([np.zeros(0), *own]) for own in ([r.way for r in seen], [r.heading for r in seen]))
    far = np.isfinite(heading) & (np.abs(way) > _MOVED * fish.length)
    way, heading = way[far], heading[far]
    total = np.abs(way).sum() if len(way) >= _WAYS else np.inf
    with_, against = (complex(np.sum(way * np.exp(sign * 1j * heading)) / total) for sign in (-1, 1))
    turned = len(seen) >= _RUNS or any(np.ptp(run.heading[np.isfinite(run.heading)]) > _TURNS for run in seen)
    opposite = turned and abs(against) > max(_CONSTANT, abs(with_) + _LESS)
    sign, link = _read(runs)
    if opposite and sign > 0:
        yield _everywhere(
            "poses-mirrored",
            "position",
            "the track turns one way, and the heading the other, which goes with the joints",
            "a fish that swims where its head points",
            "turn y over, and not the heading: import again with --set axes=y_down --set turn_to=port (y_up and "
            "starboard, if it was y_down)",
        )
    elif opposite or sign < 0:
        yield _everywhere(
            "poses-mirrored",
            "heading" if opposite else "position and heading",
            ("the heading turns against the track, and " if opposite else "")
            + "the head swings the other way than the joints force it to",
            "a head that recoils from the joints",
            "import again with "
            + (
                "--set turn_to=starboard, for a heading that grows clockwise (port, if y points down)"
                if opposite
                else "--set axes=y_down, if y points down (y_up, if it was y_down); or with --set joints.sign=-1"
            ),
        )
    elif link:
        yield _everywhere(
            "poses-heading-link",
            "heading",
            f"the heading swings as that of link '{fish.links[link].name}' does, not as that of the head",
            f"the heading of link '{fish.links[0].name}'",
            "give the column of the head's heading: import again with --heading COLUMN",
        )
    zero = float(np.angle(with_))
    varied = abs(np.exp(1j * heading).sum()) < _CONSTANT * len(heading)
    quarter = abs(math.remainder(zero, 0.5 * math.pi)) < _QUARTER
    if not opposite and abs(with_) > _CONSTANT and abs(zero) > _OFF and (varied or quarter):
        straight = "; or, as no run turns, with --set axes=y_down" if abs(against) > _CONSTANT else ""
        yield _everywhere(
            "poses-heading-zero",
            "heading",
            f"the fish swims {math.degrees(zero):.0f} degrees to port of its heading"
            + (", tail first" if abs(zero) > math.pi - _OFF else ""),
            "a fish that swims where its head points",
            "import again with --set yaw_zero=VALUE: what the column has when the fish points along x, "
            f"{abs(math.degrees(zero)):.0f} degrees from what it was{straight}",
        )


def _read(runs: Sequence[_Run]) -> tuple[int, int]:
    """Return whether the heading is mirrored, -1 or 1, and of which link it is; 1, 0 where that is not sure."""
    phased = [run for run in runs if run.phased]
    if not phased:
        return 1, 0
    products, squares = (np.mean(own, axis=0) for own in zip(*((r.products, r.squares) for r in phased), strict=True))
    pairs = [run.turns[np.isfinite(run.turns).all(axis=1)] for run in phased]
    turns = np.concatenate(
        [np.zeros((1, 2)), *(own for own in pairs if np.all(np.sum(own**2, axis=0) > _TURN**2 * len(own)))]
    )
    turn = float(turns[:, 0] @ turns[:, 1] / (np.linalg.norm(turns[:, 0]) * np.linalg.norm(turns[:, 1]) + _DUST))
    head, *links = _costs(products, squares)
    others = {(1, k): cost for k, cost in enumerate(links, start=1) if turn > -_SURE}
    if turn < _SURE:
        others[-1, 0] = _costs(-products[:, :1], squares[:, :1])[0]
    best = min(others, key=lambda reading: others[reading])
    return best if (head > _FOREIGN or turn < -_SURE) and others[best] < _EXPLAINS else (1, 0)


def _costs(products: FloatArray, squares: FloatArray) -> FloatArray:
    """Return cost(1, k) of every link (links,); both (shifts, links)."""
    scale = np.clip(products / squares, _SMALLEST, _LARGEST)
    return np.asarray(np.min(1.0 - 2.0 * scale * products + scale**2 * squares, axis=0))


def _everywhere(code: str, channel: str, found: str, expected: str, remedy: str) -> Finding:
    return Finding(code, "blocks", f"all trials, {channel}", found, expected, remedy)
