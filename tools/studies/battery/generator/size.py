"""How large an effect must be to be seen this well: lambda = |M (eta(psi) - eta(0))|^2, whitened by the true noise.

M projects out the sensitivities of the nine coefficients, and of poses those of where each run started: what is left
is what a refit cannot swallow. Of poses, what is not known of the joints counts as noise, too. All by the generator's
own runs, with a coarser step and fewer strips.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline, CubicSpline, make_interp_spline
from scipy.linalg import orth

from mjfish.numerics.arrays import FloatArray
from studies.battery.generator import world
from studies.battery.generator.classes import CAUSES, LISTED, MECHANISMS, Cause
from studies.battery.generator.draft import Draft
from studies.battery.generator.noise import whiten

#: Step of the central differences by the coefficients, relative.
_DIFFERENCE = 0.03
#: Relative change of a cause's parameters, to see what it could take of another.
_TURN = 0.1
_ROUNDS = 20
_CHORDS = 10
#: Farthest that a refit may go in the logarithm of a coefficient.
_FARTHEST = 1.5
#: Where the strength asked for cannot be had, the size is this many e-folds above the smallest, at most.
_SPREAD = 1.4
#: A strength counts as met within this share.
MET = 0.1
#: Strength, after refit, of one standard deviation of a number of a rival mechanism.
_PRIOR = 3000.0
#: How often errors of joints are drawn a run; over what time noise of measured ones is smoothed, for joints move at
#: some Hz [s]; share of the time between two samples at which the motion there is sampled.
_DRAWS, _BAND, _FINE = 40, 0.05, 0.125
#: Sizes that are tried for a strength beyond the rivals.
_TRIES = 4


@dataclass(frozen=True, eq=False)
class Ruler:
    """Measures signatures of one draft over some of its runs.

    Attributes:
        draft: measured.
        numbers: of the runs.
        span: (n, 9 or more) orthonormal, of the whitened sensitivities to the logarithms of the coefficients, and of
            poses to the starts of the runs.
        step: (9, n) takes a whitened difference to the change of those logarithms that fits it best.
        plain: (n,) whitened runs without any effect.
        unsure: (n, k) orthonormal, beyond `span`, of what errors of the joints do; none where joints are known.
        kept: (k,) share of the length that is left there, 1 / sqrt(1 + variance).
    """

    draft: Draft
    numbers: tuple[int, ...]
    span: FloatArray
    step: FloatArray
    plain: FloatArray
    unsure: FloatArray
    kept: FloatArray

    def strength(self, psi: Mapping[str, float]) -> float:
        """Return lambda of effects `psi`, all together."""
        full = stacked(self.draft, self.numbers, psi)
        return float(np.sum(self.refitted(full, {}, full - self.plain) ** 2))

    def signature(self, psi: Mapping[str, float]) -> FloatArray:
        """Return the whitened difference (n,) that `psi` makes to the plain runs."""
        return stacked(self.draft, self.numbers, psi) - self.plain

    def refitted(self, full: FloatArray, rest: Mapping[str, float], left: FloatArray) -> FloatArray:
        """Return what a refit of the coefficients leaves (n,) of runs `full`, with effects `rest` in the model.

        Chord steps in the logarithms of the coefficients, from the difference `left` at the true ones: a large effect
        that is all but a coefficient in disguise is not linear.
        """
        best = last = self.beyond(left)
        moved = np.zeros(len(self.draft.theta))
        for _ in range(_CHORDS):
            moved = np.clip(moved + self.step @ left, -_FARTHEST, _FARTHEST)
            changed = dict(zip(self.draft.theta, np.array([*self.draft.theta.values()]) * np.exp(moved), strict=True))
            left = full - stacked(self.draft, self.numbers, rest, changed)
            now = self.beyond(left)
            best = now if now @ now < best @ best else best
            if abs(now @ now - last @ last) < 0.02 * (last @ last):
                break
            last = now
        return best

    def beyond(self, signature: FloatArray) -> FloatArray:
        """Return what a linear refit of the coefficients leaves of a signature (n,), whitened by all noise."""
        left = _out(self.span, signature)
        return np.asarray(left + self.unsure @ ((self.kept - 1.0) * (self.unsure.T @ left)))


def _out(basis: FloatArray, vector: FloatArray) -> FloatArray:
    return np.asarray(vector - basis @ (basis.T @ vector))


def stacked(
    draft: Draft, numbers: Sequence[int], psi: Mapping[str, float], theta: Mapping[str, float] | None = None
) -> FloatArray:
    """Return the whitened noise-free runs, one after another (n,)."""
    return _whitened(draft, [draft.clean(i, psi, theta=theta) for i in numbers])


def _whitened(draft: Draft, parts: Sequence[FloatArray]) -> FloatArray:
    """Return parts (m, 3) of the runs, whitened, one after another (n,)."""
    return np.concatenate([whiten(draft.noise, part).ravel() for part in parts])


def ruler(draft: Draft, numbers: Sequence[int]) -> Ruler:
    """Compute the sensitivities of the coefficients over some runs."""
    paths = [draft.clean(i, {}) for i in numbers]
    plain, columns = _whitened(draft, paths), []
    for name, value in draft.theta.items():
        up, down = ({**draft.theta, name: value * (1.0 + sign * _DIFFERENCE)} for sign in (1.0, -1.0))
        change = stacked(draft, numbers, {}, up) - stacked(draft, numbers, {}, down)
        columns.append(change / np.log((1.0 + _DIFFERENCE) / (1.0 - _DIFFERENCE)))
    poses = draft.noise.kind == "poses"
    jacobian = np.column_stack(columns + (_starts(draft, paths) if poses else []))
    span, _ = np.linalg.qr(jacobian / np.linalg.norm(jacobian, axis=0))
    errors = [_out(span, column) for column in (_joint_errors(draft, numbers, paths) if poses else [])]
    unsure, lengths, _ = np.linalg.svd(np.array(errors).reshape(-1, len(plain)).T, full_matrices=False)
    step = np.linalg.pinv(jacobian)[: len(draft.theta)]
    return Ruler(draft, tuple(numbers), span, step, plain, unsure, 1.0 / np.sqrt(1.0 + lengths**2))


def _starts(draft: Draft, paths: Sequence[FloatArray]) -> list[FloatArray]:
    """Return what x, y and yaw at the start of each run change of the poses, whitened (n,)."""
    found = []
    for i, path in enumerate(paths):
        turned = np.column_stack([-path[:, 1], path[:, 0], np.ones(len(path))])
        moved = [np.tile(axis, (len(path), 1)) for axis in ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0])]
        found += [_of_run(draft, paths, i, change) for change in (*moved, turned)]
    return found


def _joint_errors(draft: Draft, numbers: Sequence[int], paths: Sequence[FloatArray]) -> list[FloatArray]:
    """Return what errors of the joints do to the poses, whitened (n,); the sum of their squares is the covariance.

    Samples do not say how a joint moves in between. The error of the smoothest curve through samples without noise
    counts as one standard deviation: all of it alike, and in _DRAWS draws of every stretch between two samples by
    itself. Noise of measured joints is drawn as often, smoothed over _BAND.
    """
    how = draft.noise
    if how.joints == "cpg":
        return []
    rng, found = np.random.default_rng([draft.seed, 79]), []
    for place, number in enumerate(numbers):
        run, time = draft.plan.runs[number], draft.time(number)
        angle = world.angles(draft.fish, run, {}, time)
        smooth = _smoothest(time, angle)
        known = draft.clean(number, {}, joints=smooth)
        found.append(_of_run(draft, paths, place, known - paths[place]))
        if how.joints == "measured":
            knots, fine = np.arange(0.0, time[-1] + 2.0 * _BAND, _BAND), time
            size = np.full_like(angle, how.angle / np.sqrt(max(_BAND * how.rate, 1.0)))
        else:
            knots, fine = time, np.interp(np.arange(0.0, len(time) - 1.0 + _FINE, _FINE), np.arange(len(time)), time)
            size = world.angles(draft.fish, run, {}, fine) - smooth(fine)
        for _ in range(_DRAWS):
            noise = CubicSpline(knots, rng.standard_normal((len(knots), angle.shape[1])))(fine)
            moved = draft.clean(number, {}, joints=_smoothest(fine, smooth(fine) + size * noise))
            found.append(_of_run(draft, paths, place, (moved - known) / np.sqrt(_DRAWS)))
    return found


def _smoothest(time: FloatArray, angle: FloatArray) -> BSpline:
    """Return the curve through samples of the least third derivative."""
    free = [(3, np.zeros(angle.shape[1])), (4, np.zeros(angle.shape[1]))]
    return make_interp_spline(time, angle, k=5, bc_type=(free, free))


def _of_run(draft: Draft, paths: Sequence[FloatArray], place: int, change: FloatArray) -> FloatArray:
    """Return a change (m, 3) of one run, whitened, among zeros for all others (n,)."""
    return _whitened(draft, [change if i == place else np.zeros_like(path) for i, path in enumerate(paths)])


@dataclass(frozen=True)
class Sized:
    """Effects at their sizes.

    Attributes:
        psi: all parameters.
        strength, absorbed, reached: by cause; see `studies.battery.generator.truth.Truth`.
    """

    psi: dict[str, float]
    strength: dict[str, float]
    absorbed: dict[str, float]
    reached: dict[str, bool]


def sized(
    measure: Ruler,
    causes: Sequence[Cause],
    directions: Sequence[Mapping[str, float]],
    strengths: Sequence[float],
) -> Sized:
    """Find the sizes at which each cause has its strength given the others.

    Effects are not linear: bracketed secant steps on the root of the strength, at most _ROUNDS.
    """
    size = np.array([max(min(1.0, 0.3 * cause.high), cause.low) for cause in causes])
    history: list[tuple[FloatArray, FloatArray]] = []
    for _ in range(_ROUNDS):
        found = _lengths(measure, causes, directions, size)
        history.append((size, found))
        if np.all(np.abs((found / np.sqrt(strengths)) ** 2 - 1.0) < 0.02):
            break
        if np.all((size <= [c.low for c in causes]) & (found**2 > strengths)):
            # However small, it is seen (a servo that starts from rest kicks): some size, and the strength it has.
            size = np.array([min(c.low * np.exp(measure.draft.rng.uniform(0.0, _SPREAD)), c.high) for c in causes])
            history = [(size, _lengths(measure, causes, directions, size))]
            break
        size = _next(history, np.sqrt(np.array(strengths)), causes)
    best = min(range(len(history)), key=lambda i: float(np.max(np.abs(np.log(history[i][1] ** 2 / strengths)))))
    size, found = history[best]
    whole, own = _signatures(measure, causes, directions, size)
    psi: dict[str, float] = {}
    for cause, direction, s in zip(causes, directions, size, strict=True):
        psi |= cause.sized(direction, float(s))
    names = [cause.name for cause in causes]
    left = [float(np.sum(o**2) / max(np.sum(v**2), 1e-300)) for o, v in zip(own, whole, strict=True)]
    met = [bool(abs(f**2 / s - 1.0) < MET) for f, s in zip(found, strengths, strict=True)]
    return Sized(
        psi,
        dict(zip(names, (float(f) ** 2 for f in found), strict=True)),
        dict(zip(names, (1.0 - share for share in left), strict=True)),
        dict(zip(names, met, strict=True)),
    )


def sized_beyond_rivals(
    measure: Ruler, cause: Cause, direction: Mapping[str, float], strength: float, seed: int
) -> Sized:
    """Find the size at which a cause has its strength beyond the coefficients and any one rival mechanism."""
    bases = rival_bases(measure, cause, seed)
    wanted = strength
    for _ in range(_TRIES):
        found = sized(measure, [cause], [direction], [wanted])
        full = stacked(measure.draft, measure.numbers, found.psi)
        left = share_beyond(bases, measure.refitted(full, {}, full - measure.plain)) * found.strength[cause.name]
        if abs(left / strength - 1.0) < MET or not found.reached[cause.name]:
            break
        wanted *= strength / max(left, 1e-6 * strength)
    return replace(found, strength={cause.name: left}, reached={cause.name: abs(left / strength - 1.0) < MET})


def _signatures(
    measure: Ruler, causes: Sequence[Cause], directions: Sequence[Mapping[str, float]], size: FloatArray
) -> tuple[list[FloatArray], list[FloatArray]]:
    """Return each cause's signature with the others on, whole and beyond refit of the coefficients and the others."""
    parts = [cause.sized(d, float(s)) for cause, d, s in zip(causes, directions, size, strict=True)]
    everything = {key: value for part in parts for key, value in part.items()}
    full = stacked(measure.draft, measure.numbers, everything)
    rests = [
        {key: value for j, part in enumerate(parts) if j != i for key, value in part.items()} for i in range(len(parts))
    ]
    whole = [full - (stacked(measure.draft, measure.numbers, rest) if rest else measure.plain) for rest in rests]
    turned = [_turned(measure, part, everything, full) for part in parts] if len(parts) > 1 else []
    own = []
    for i, (rest, signature) in enumerate(zip(rests, whole, strict=True)):
        left = measure.refitted(full, rest, signature)
        others = [measure.beyond(v) for j in range(len(turned)) if j != i for v in (whole[j], *turned[j])]
        own.append(_out(orth(np.column_stack(others), rcond=1e-6), left) if others else left)
    return whole, own


def _turned(
    measure: Ruler, part: Mapping[str, float], everything: Mapping[str, float], full: FloatArray
) -> list[FloatArray]:
    """Return what a change of each parameter of a cause does to runs `full`: a refit of it has them all free."""
    if len(part) < 2:
        return []
    moved = [{**everything, name: (1.0 + _TURN) * value} for name, value in part.items()]
    return [stacked(measure.draft, measure.numbers, psi) - full for psi in moved]


def _lengths(
    measure: Ruler, causes: Sequence[Cause], directions: Sequence[Mapping[str, float]], size: FloatArray
) -> FloatArray:
    return np.array([float(np.linalg.norm(own)) for own in _signatures(measure, causes, directions, size)[1]])


def _next(history: list[tuple[FloatArray, FloatArray]], target: FloatArray, causes: Sequence[Cause]) -> FloatArray:
    """Return the next sizes: in proportion, then by the secant; the middle of the bracket where that leaves it."""
    chosen = []
    for i, cause in enumerate(causes):
        seen = [(float(s[i]), float(f[i])) for s, f in history]
        size, found = seen[-1]
        step = size * float(np.clip(target[i] / max(found, 1e-12), 0.05, 20.0))
        if len(seen) > 1 and seen[-2][0] != size:
            slope = (found - seen[-2][1]) / (size - seen[-2][0])
            step = size + (target[i] - found) / slope if slope > 0.0 else step
        below = max((s for s, f in seen if f <= target[i]), default=max(cause.low, 1e-4 * cause.high))
        above = min((s for s, f in seen if f > target[i] and s > below), default=cause.high)
        inside = below < step < above
        bracketed = any(s == below for s, _ in seen) and any(s == above for s, _ in seen)
        if not inside:
            step = float(np.sqrt(below * above)) if bracketed else float(np.clip(step, below, above))
        chosen.append(step)
    return np.array(chosen)


def rivals(measure: Ruler, cause: Cause, psi: Mapping[str, float], seed: int) -> dict[str, float]:
    """Return the correlation, after refit, of the signature of `psi` with each other cause of the list.

    A cause of several parameters counts with all of them: the cosine of the smallest angle to their span.
    """
    own = measure.beyond(measure.signature(psi))
    length = float(np.linalg.norm(own))
    found = {}
    for other in LISTED:
        if other.name == cause.name or (other.needs_pose and not measure.draft.plan.pose):
            continue
        columns = [measure.beyond(measure.signature(axis)) for axis in _axes(other, seed)]
        basis, _ = np.linalg.qr(np.column_stack(columns))
        found[other.name] = float(np.linalg.norm(basis.T @ own) / max(length, 1e-300))
    return found


def _axes(cause: Cause, seed: int) -> list[dict[str, float]]:
    """Return one set of parameters for each number of a cause that may vary, the others at null; shapes as drawn."""
    drawn = cause.draw(np.random.default_rng(seed))
    sizes = [key for key in drawn if key not in cause.shapes]
    typical = max(abs(drawn[key]) for key in sizes)
    shapes = {key: drawn[key] for key in cause.shapes}
    if cause.series:
        fixed = {**shapes, **dict.fromkeys(sizes, typical), **dict.fromkeys(cause.series, 0.0)}
        pairs = zip(cause.series[::2], cause.series[1::2] or cause.series[::2], strict=False)
        return [{**fixed, **dict.fromkeys(pair, 1.0)} for pair in pairs]  # neighbours: half as many runs
    if not cause.listed:
        return [drawn]  # numbers that make up one law
    return [{**shapes, **dict.fromkeys(sizes, 0.0), key: typical} for key in sizes]


def rival_bases(measure: Ruler, cause: Cause, seed: int) -> list[FloatArray]:
    """Return the penalised basis (n, k) of every other mechanism: what all its causes can do, beyond the coefficients.

    A column is what one standard deviation of a number does, at a strength of _PRIOR.
    """
    found: dict[str, list[FloatArray]] = {}
    for other in CAUSES.values():
        mechanism = MECHANISMS.get(other.name, MECHANISMS[cause.name])
        if mechanism == MECHANISMS[cause.name] or (other.needs_pose and not measure.draft.plan.pose):
            continue
        for axis in _axes(other, seed):
            column = measure.beyond(measure.signature(axis))
            length = float(np.linalg.norm(column))
            if length > 1e-3:
                found.setdefault(mechanism, []).append(column * np.sqrt(_PRIOR) / length)
    return [np.column_stack(columns) for columns in found.values()]


def share_beyond(bases: Sequence[FloatArray], own: FloatArray) -> float:
    """Return the least share of |own|^2 that a penalised basis leaves: of s, s's - s'B (B'B + 1)^-1 B's."""
    shares = []
    for basis in bases:
        mixed = basis.T @ own
        taken = mixed @ np.linalg.solve(basis.T @ basis + np.eye(len(mixed)), mixed)
        shares.append(1.0 - float(taken) / max(float(own @ own), 1e-300))
    return min(shares, default=1.0)
