"""A batch smoother: all frames of a run at once, coordinates as splines plus harmonics of the beat, noise by evidence.

Every coordinate is a smooth course plus harmonics of the beat,

    c(t) = sum_i s_i B_i(t) + sum_k [a_k cos(2 pi k f t) + b_k sin(2 pi k f t)]

B are quintic B-splines whose prior is that of the smoothing spline of order 6, p(s) ~ exp(-INT c'''^2 dt / (2 q)): a
twice-integrated white acceleration of intensity q ([Wahba1990], ch. 1.5). The harmonics have no such prior. Motion that
repeats with the beat is therefore known in a gap too; other motion is known as far as it is smooth.

The posterior of the coefficients a and of the parameters that all frames share (`Observation`) follows by Gauss-Newton
steps on

    sum_points w |u - u(a)|^2 / sigma_m^2 + sum_c a_c' R a_c / q_c + priors

The noise sigma_m of every point and the intensity q_c of every coordinate maximise the evidence ([MacKay1992]):

    sigma_m^2 = tau sum w r^2 / (d n_m - leverage_m),   q_c = (a_c' R a_c + trace(R C_cc)) / rank R

Tracking errors are autocorrelated, and a smooth motion meets the spectral density of the noise at low frequencies: tau,
the median over the points of 1 + 2 sum of the residual's autocorrelations, is the ratio of that density to the density
of white noise of equal variance.

The first passes use the weights w of a Student distribution with 4 degrees of freedom, so that lost and stuck points do
not pull. The last ones count points within four sigma fully and all others not at all, so that the covariance is that
of Gaussian noise.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import linalg
from scipy.interpolate import BSpline
from scipy.optimize import minimize_scalar

from mjfish.errors import InputError
from mjfish.numerics.arrays import BoolArray, FloatArray, readonly

_DEGREE = 5
#: Knots a beat, and the widest and the narrowest distance of knots [s].
_KNOTS, _WIDEST, _NARROWEST = 11.0, 0.2, 0.03
#: Distance of knots where there is no beat [s].
_WITHOUT = 0.05


@dataclass(frozen=True, eq=False)
class Basis:
    """Functions of time that every coordinate is made of.

    Attributes:
        time: (n,) [s].
        knots: of the splines [s].
        harmonics: how many of the beat.
    """

    time: FloatArray
    knots: FloatArray
    harmonics: int

    @staticmethod
    def of(time: FloatArray, beat: float | None, harmonics: int) -> Basis:
        """Return the basis for times (n,) [s] and a beat [Hz], None where the motion has none."""
        span = float(time[-1] - time[0])
        apart = _WITHOUT if beat is None else float(np.clip(1.0 / (_KNOTS * beat), _NARROWEST, _WIDEST))
        inner = np.linspace(time[0], time[-1], max(int(np.ceil(span / apart)), 4) + 1)
        knots = np.concatenate([np.full(_DEGREE, time[0]), inner, np.full(_DEGREE, time[-1])])
        return Basis(time, readonly(knots), 0 if beat is None else harmonics)

    @property
    def splines(self) -> int:
        """Number of splines."""
        return len(self.knots) - _DEGREE - 1

    @property
    def size(self) -> int:
        """Number of functions."""
        return self.splines + 2 * self.harmonics

    def design(self, beat: float | None, order: int = 0) -> FloatArray:
        """Return the functions (order 0) or their rates (order 1) at the times: (n, size)."""
        columns = [_evaluated(self.time.tobytes(), self.knots.tobytes(), order)]
        for k in range(1, self.harmonics + 1):
            omega = 2.0 * np.pi * k * float(beat or 0.0)
            phase = omega * (self.time - self._middle)
            cos, sin = np.cos(phase), np.sin(phase)
            columns.append(np.column_stack([cos, sin] if order == 0 else [-omega * sin, omega * cos]))
        return np.concatenate(columns, axis=1)

    def stretched(self, beat: float | None) -> FloatArray:
        """Return the derivative (n, size) of the functions by the logarithm of the beat."""
        slope = self.design(beat, order=1) * (self.time - self._middle)[:, None]
        slope[:, : self.splines] = 0.0
        return slope

    @property
    def _middle(self) -> float:
        return 0.5 * float(self.time[0] + self.time[-1])

    def roughness(self) -> FloatArray:
        """Return INT B_i''' B_j''' dt (splines, splines): piecewise quartic, three Gauss points are exact."""
        ends = np.unique(self.knots)
        points, weights = np.polynomial.legendre.leggauss(3)
        half = 0.5 * np.diff(ends)
        at = (0.5 * (ends[:-1] + ends[1:])[:, None] + half[:, None] * points).ravel()
        third = BSpline(self.knots, np.eye(self.splines), _DEGREE)(at, nu=3)
        return np.asarray((third * (half[:, None] * weights).ravel()[:, None]).T @ third)


@functools.lru_cache(maxsize=8)
def _evaluated(time: bytes, knots: bytes, order: int) -> FloatArray:
    t = np.frombuffer(knots)
    return readonly(BSpline(t, np.eye(len(t) - _DEGREE - 1), _DEGREE)(np.frombuffer(time), nu=order))


IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Linearised:
    """Predicted points and their derivatives.

    Attributes:
        value: (n, points, d).
        of_frame: (n, points, d, coordinates) by the coordinates of the frame.
        shared: (n, points, d, shared) by what all frames share.
    """

    value: FloatArray
    of_frame: FloatArray
    shared: FloatArray


class Observation(Protocol):
    """Points that are seen in every frame, as a function of the frame's coordinates and of what all frames share."""

    @property
    def measured(self) -> FloatArray:
        """(n, points, d); what was not seen is NaN."""
        ...

    @property
    def coordinates(self) -> int:
        """Number of coordinates a frame."""
        ...

    @property
    def kinds(self) -> IntArray:
        """(coordinates,) numbers; coordinates of a number are equally smooth."""
        ...

    @property
    def belief(self) -> FloatArray:
        """(shared,) standard deviations about zero that are believed of what all frames share."""
        ...

    @property
    def form(self) -> FloatArray:
        """(coordinates, coordinates) precision believed of the coordinates, about zero, once for every look."""
        ...

    def at(self, coordinates: FloatArray, shared: FloatArray) -> Linearised:
        """Return the points for coordinates (n, coordinates) and shared (shared,)."""
        ...


#: Belief about every coefficient [m or rad]: wide; and about the logarithm of the beat.
_WIDE, _BEAT = 30.0, 0.05


@dataclass(frozen=True, eq=False)
class State:
    """Where the fit stands; see `Fit`."""

    beat: float | None
    coefficients: FloatArray
    shared: FloatArray
    sigma: FloatArray
    intensity: FloatArray


@dataclass(frozen=True, eq=False)
class System:
    """The normal equations at one state, and what they were made of."""

    normal: FloatArray
    right: FloatArray
    residual: FloatArray
    of_frame: FloatArray
    shared: FloatArray
    design: FloatArray

    @classmethod
    def of(cls, seen: Observation, basis: Basis, state: State, weight: FloatArray, rough: FloatArray) -> System:
        """Linearise at a state, with weights (n, points) and the roughness (size, size) of the basis."""
        design = basis.design(state.beat)
        here = seen.at(design @ state.coefficients.T, state.shared)
        residual = np.where(weight[..., None] > 0.0, seen.measured - here.value, 0.0)
        shared = _with_beat(here, basis, state)
        scaled = weight / np.square(state.sigma)
        weighted = here.of_frame * scaled[..., None, None]
        own = np.einsum("npdi,npdj->nij", weighted, here.of_frame, optimize=True)
        mixed = np.einsum("npdi,npdj->nij", weighted, shared, optimize=True)
        right_own = np.einsum("npdi,npd->ni", weighted, residual, optimize=True)
        weighted_shared = shared * scaled[..., None, None]
        count, size = state.coefficients.shape
        total = count * size + shared.shape[3]
        normal, right = np.zeros((total, total)), np.zeros(total)
        for i in range(count):
            rows = slice(i * size, (i + 1) * size)
            for j in range(i + 1):
                normal[rows, j * size : (j + 1) * size] = design.T @ (own[:, i, j, None] * design)
            normal[count * size :, rows] = (design.T @ mixed[:, i]).T
            right[rows] = design.T @ right_own[:, i]
        normal[count * size :, count * size :] = np.einsum("npdi,npdj->ij", weighted_shared, shared, optimize=True)
        right[count * size :] = np.einsum("npdi,npd->i", weighted_shared, residual, optimize=True)
        normal = np.tril(normal) + np.tril(normal, -1).T
        _believe(normal, right, seen, basis, state, rough)
        return cls(normal, right, residual, here.of_frame, shared, design)

    def step(self, state: State, covariance: FloatArray) -> tuple[State, float]:
        """Return the state after a Gauss-Newton step and its length in units of its own uncertainty."""
        move = covariance @ self.right
        count, size = state.coefficients.shape
        own, shared = np.split(move, [count * size])
        beat = state.beat
        if beat is not None:
            beat *= float(np.exp(np.clip(shared[-1], -_BEAT, _BEAT)))
            shared = shared[:-1]
        moved = float(np.sqrt(abs(move @ self.right) / len(move)))
        new = replace(
            state, beat=beat, coefficients=state.coefficients + own.reshape(count, size), shared=state.shared + shared
        )
        return new, moved

    def covariance(self) -> FloatArray:
        """Return the covariance of all unknowns."""
        factor, _ = linalg.cho_factor(self.normal, lower=True)
        lower, _ = linalg.lapack.dpotri(factor, lower=True)
        return np.asarray(np.tril(lower) + np.tril(lower, -1).T)


def _with_beat(here: Linearised, basis: Basis, state: State) -> FloatArray:
    """Return the derivatives by what is shared, with a last column for the logarithm of the beat."""
    if state.beat is None:
        return here.shared
    rate = basis.stretched(state.beat) @ state.coefficients.T
    return np.concatenate([here.shared, np.einsum("npdi,ni->npd", here.of_frame, rate)[..., None]], axis=3)


def _believe(
    normal: FloatArray, right: FloatArray, seen: Observation, basis: Basis, state: State, rough: FloatArray
) -> None:
    """Add the beliefs about coefficients and what is shared to the normal equations."""
    count, size = state.coefficients.shape
    design = basis.design(state.beat)
    looks = (1 + 2 * basis.harmonics) / len(design)
    gram = looks * design.T @ design
    form = seen.form
    for i in range(count):
        rows = slice(i * size, (i + 1) * size)
        own = rough / state.intensity[i] + np.eye(size) / _WIDE**2
        normal[rows, rows] += own
        right[rows] -= own @ state.coefficients[i]
        for j in np.flatnonzero(form[i]):
            normal[rows, j * size : (j + 1) * size] += form[i, j] * gram
            right[rows] -= form[i, j] * gram @ state.coefficients[j]
    belief = 1.0 / np.square(seen.belief)
    at = np.arange(count * size, count * size + len(belief))
    normal[at, at] += belief
    right[at] -= belief * state.shared
    if state.beat is not None:
        normal[-1, -1] += 1.0 / _BEAT**2


#: An intensity is believed to be `_LOW` of what it starts from, as much as so many known coefficients say, and stays
#: between two shares of it: at the lower end a parabola and harmonics are left.
_HELD, _LOW, _LEAST, _MOST = 0.01, 1e-4, 1e-8, 1.0
#: Longest step, in steps of expectation maximisation.
_LONGEST = 5.0
#: Converged is what moves by less than this share.
_CONVERGED = 0.02


def first_intensity(start: FloatArray, kinds: IntArray, beat: float | None) -> FloatArray:
    """Return intensities (coordinates,) of a motion as rough as a tenth of the range at twice the beat."""
    omega = 2.0 * np.pi * 2.0 * (beat or 1.0)
    line = np.linspace(start[0], start[-1], len(start))
    rough = np.square((0.1 * np.ptp(start - line, axis=0) + 1e-3) * omega**3) / omega
    return np.asarray([rough[kinds == kind].mean() for kind in kinds])


def noise_by_evidence(system: System, covariance: FloatArray, weight: FloatArray, state: State) -> FloatArray:
    """Return the noise of the points (points,) that maximises the evidence."""
    by_frame = _by_frame(system, covariance, *state.coefficients.shape)
    slopes = np.concatenate([system.of_frame, system.shared], axis=3)
    leverage = np.einsum("npdi,nij,npdj->np", slopes, by_frame, slopes, optimize=True)
    leverage = (weight * leverage).sum(axis=0) / np.square(state.sigma)
    squares = (weight * np.square(system.residual).sum(axis=2)).sum(axis=0)
    directions = system.residual.shape[2]
    free = directions * (weight > 0.0).sum(axis=0) - leverage
    # The noise of a point that its own coordinate follows exactly is unknown: it gets the mean of all points.
    pooled = squares.sum() / max(float(free.sum()), 1.0)
    enough = free > 0.05 * directions * weight.shape[0]
    variance = np.where(enough, squares / np.maximum(free, 1e-9), pooled)
    return np.asarray(np.sqrt(variance * float(np.median(correlation_frames(system.residual)))))


def correlation_frames(residual: FloatArray) -> FloatArray:
    """Return how many frames (points,) the errors of a point stay alike: 1 + 2 sum of its autocorrelations.

    Errors of tracking wander. A smooth motion meets the spectral density of the noise at low frequencies, which is that
    many times the one of white noise of equal variance. The sum ends where a pair of lags is no longer positive
    ([Geyer1992], sect. 3.3).
    """
    n = len(residual)
    power = np.square(np.abs(np.fft.rfft(residual, 2 * n, axis=0))).sum(axis=2)
    products = np.fft.irfft(power, axis=0)[: n // 4]
    correlation = products / np.maximum(products[0], 1e-300)
    pairs = correlation[1:-1:2] + correlation[2::2]
    going = np.cumprod(pairs > 0.0, axis=0)
    return np.asarray(np.clip(1.0 + 2.0 * (pairs * going).sum(axis=0), 1.0, n / 8))


def _by_frame(system: System, covariance: FloatArray, count: int, size: int) -> FloatArray:
    """Return the covariance of coordinates and shared, frame by frame (n, k, k)."""
    design, shared = system.design, covariance.shape[0] - count * size
    found = np.empty((len(design), count + shared, count + shared))
    for i in range(count):
        rows = slice(i * size, (i + 1) * size)
        for j in range(i + 1):
            block = covariance[rows, j * size : (j + 1) * size]
            found[:, i, j] = found[:, j, i] = np.einsum("ni,ni->n", design @ block, design)
        found[:, i, count:] = design @ covariance[rows, count * size :]
        found[:, count:, i] = found[:, i, count:]
    found[:, count:, count:] = covariance[count * size :, count * size :]
    return found


def intensity_by_evidence(
    state: State, covariance: FloatArray, rough: FloatArray, basis: Basis, kinds: IntArray, first: FloatArray
) -> FloatArray:
    """Return the intensities (coordinates,) that maximise the evidence, one for each kind."""
    count, size = state.coefficients.shape
    squares, known = np.zeros(count), np.zeros(count)
    rank = float(basis.splines - 3)
    for i in range(count):
        rows = slice(i * size, (i + 1) * size)
        own = state.coefficients[i]
        squares[i] = own @ rough @ own / state.intensity[i]
        known[i] = rank - float((rough * covariance[rows, rows]).sum()) / state.intensity[i]
    found = np.empty(count)
    for kind in np.unique(kinds):
        same_kind = kinds == kind
        held = _HELD * _LOW * float((first[same_kind] / state.intensity[same_kind]).mean())
        # The step of expectation maximisation, which is safe, lengthened where the data know few of the coefficients.
        unknown = float((rank - known[same_kind]).sum())
        ratio = (float(squares[same_kind].sum()) + unknown + held) / (rank * same_kind.sum() + _HELD)
        longer = min(rank * same_kind.sum() / max(float(known[same_kind].sum()), 1.0), _LONGEST)
        found[same_kind] = state.intensity[same_kind] * ratio**longer
    return np.clip(found, _LEAST * first, _MOST * first)


def has_converged(before: State, after: State) -> bool:
    """Return whether noise and intensities stay; the sixth root of an intensity is a frequency."""
    by_noise = np.abs(np.log(after.sigma / before.sigma)).max()
    smooth = np.abs(np.log(after.intensity / before.intensity)).max() / 6.0
    return bool(max(by_noise, smooth) < _CONVERGED)


#: Degrees of freedom of the Student weights; points farther than so many sigma do not count in the end.
_STUDENT, _GATE = 4.0, 4.0
_ROBUST, _PASSES = 7, 12
#: The passes end where noise and smoothness have converged and no unknown moves by more than this share of its
#: own sigma.
_MOVED = 0.05


@dataclass(frozen=True, eq=False)
class Fit(State):
    """Coordinates over time and what is known of their errors.

    Attributes:
        basis: the functions.
        beat: [Hz], None without harmonics.
        coefficients: (coordinates, size) of the functions.
        shared: what all frames share.
        sigma: (points,) noise of each point in each of its d directions.
        counted: (n, points) which points count.
        intensity: (coordinates,) of the splines' prior.
        covariance: of coefficients, shared and the logarithm of the beat, in this order.
        residual: (n, points, d) measured minus fitted; NaN where nothing was measured.
        frames: (points,) how many frames the errors of a point stay alike.
    """

    basis: Basis
    counted: BoolArray
    covariance: FloatArray
    residual: FloatArray
    frames: FloatArray

    def coordinates(self, order: int = 0) -> FloatArray:
        """Return the coordinates (n, coordinates), or their rates."""
        return np.asarray(self.basis.design(self.beat, order) @ self.coefficients.T)

    def gradient(self, coordinate: int, order: int = 0) -> FloatArray:
        """Return the derivative (n, unknowns) of one coordinate, or its rate, by all unknowns."""
        size = self.coefficients.shape[1]
        rows = np.zeros((len(self.basis.time), len(self.covariance)))
        rows[:, coordinate * size : (coordinate + 1) * size] = self.basis.design(self.beat, order)
        if self.beat is not None:
            own = self.coefficients[coordinate]
            rows[:, -1] = self.basis.stretched(self.beat) @ own
            if order:
                # d/dlnf of k w (..) is the rate itself, and what the stretched phase does to it.
                rows[:, -1] = _stretched_rate(self.basis, self.beat) @ own
        return rows


def _stretched_rate(basis: Basis, beat: float) -> FloatArray:
    """Return the derivative (n, size) of the functions' rates by the logarithm of the beat, by a central step."""
    step = 1e-5
    return np.asarray((basis.design(beat * (1 + step), 1) - basis.design(beat * (1 - step), 1)) / (2 * step))


def smooth(seen: Observation, basis: Basis, beat: float | None, start: FloatArray, sigma: float) -> Fit:
    """Fit coordinates to what was seen.

    Args:
        seen: points and how they follow from coordinates.
        basis: functions of time at the frames.
        beat: to begin with [Hz]; None without harmonics.
        start: (n, coordinates) to begin with.
        sigma: of the points, to begin with; rather too large.

    Raises:
        InputError: the points are so far apart, or the times so uneven, that no motion can be fitted.
    """
    try:
        with np.errstate(over="raise", divide="raise", invalid="raise"):
            return _smoothed(seen, basis, beat, start, sigma)
    except (FloatingPointError, np.linalg.LinAlgError) as error:
        raise InputError(
            f"cannot be smoothed ({error}), expected the path of a swimming fish; look for numbers or times far off"
        ) from None


def _smoothed(seen: Observation, basis: Basis, beat: float | None, start: FloatArray, sigma: float) -> Fit:
    measured = seen.measured
    there: BoolArray = np.asarray(np.isfinite(measured).all(axis=2))
    rough = np.pad(basis.roughness(), (0, basis.size - basis.splines))
    first = first_intensity(start, seen.kinds, beat)
    state = State(
        beat,
        np.asarray(np.linalg.lstsq(basis.design(beat), start, rcond=1e-8)[0].T),
        np.zeros(len(seen.belief)),
        np.full(measured.shape[1], sigma),
        first,
    )
    weight: FloatArray = np.asarray(there, dtype=np.float64)
    for number in range(_ROBUST + _PASSES):
        system = System.of(seen, basis, state, weight, rough)
        covariance = system.covariance()
        before = state
        if number:  # a first step comes before any judgement of the noise
            state = replace(
                state,
                sigma=noise_by_evidence(system, covariance, weight, state),
                intensity=intensity_by_evidence(state, covariance, rough, basis, seen.kinds, first),
            )
        state, moved = system.step(state, covariance)
        weight = _weights(seen, basis, state, there, student=number < _ROBUST)
        if number > _ROBUST and moved < _MOVED and has_converged(before, state):
            break
    system = System.of(seen, basis, state, weight, rough)
    covariance = system.covariance()
    return Fit(
        state.beat, state.coefficients, state.shared, state.sigma, state.intensity, basis, np.asarray(weight > 0.0),
        covariance, _residual(seen, basis, state), correlation_frames(system.residual),
    )  # fmt: skip


def _residual(seen: Observation, basis: Basis, state: State) -> FloatArray:
    """Return measured minus fitted, of points that do not count too."""
    return np.asarray(seen.measured - seen.at(basis.design(state.beat) @ state.coefficients.T, state.shared).value)


def _weights(seen: Observation, basis: Basis, state: State, there: BoolArray, *, student: bool) -> FloatArray:
    off = np.nan_to_num(np.square(_residual(seen, basis, state)).sum(axis=2), nan=np.inf) / np.square(state.sigma)
    directions = seen.measured.shape[2]
    if student:
        return np.asarray(np.where(there, (_STUDENT + directions) / (_STUDENT + off), 0.0))
    return np.asarray((off < _GATE**2 + directions).astype(np.float64))


#: Frequencies among which the beat is searched [Hz].
SLOWEST, FASTEST = 0.15, 6.0
#: Share of a motion's variance that a beat with one overtone must explain.
_PERIODIC = 0.7


def beat_frequency(time: FloatArray, lateral: FloatArray) -> tuple[float, bool]:
    """Return the frequency [Hz] that, with a drift, leaves the least of a motion (n,), and whether it is a beat."""
    share = time / max(float(np.ptp(time)), 1e-9)

    def sum_of_squares(trial: float, harmonics: int = 1) -> float:
        phase = 2.0 * np.pi * trial * time
        waves = [wave(k * phase) for k in range(1, harmonics + 1) for wave in (np.cos, np.sin)]
        design = np.column_stack([np.ones_like(time), share, *waves])
        return float(np.square(lateral - design @ np.linalg.lstsq(design, lateral)[0]).sum())

    slowest = max(SLOWEST, 1.0 / float(np.ptp(time)))
    step = 0.1 / float(np.ptp(time))
    trials = np.arange(slowest, FASTEST, step)
    best = float(trials[int(np.argmin([sum_of_squares(trial) for trial in trials]))])
    refined = float(
        minimize_scalar(sum_of_squares, bounds=(max(best - step, 0.5 * slowest), best + step), method="bounded").x
    )
    periodic = sum_of_squares(refined, 2) < (1.0 - _PERIODIC) * max(sum_of_squares(refined, 0), 1e-300)
    return refined, periodic
