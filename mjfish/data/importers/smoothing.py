"""A batch smoother: all frames of a run at once, coordinates as splines plus harmonics of the beat, noise by evidence.

Every coordinate is a smooth course plus harmonics of the beat,

    c(t) = sum_i s_i B_i(t) + sum_k [a_k cos(2 pi k f t) + b_k sin(2 pi k f t)]

B are quintic B-splines whose prior is that of the smoothing spline of order 6, p(s) ~ exp(-INT c'''^2 dt / (2 q)): a
twice-integrated white acceleration of intensity q ([Wahba1990], ch. 1.5). The harmonics have no such prior. Motion that
repeats with the beat is therefore known in a gap too; other motion is known as far as it is smooth.

The posterior of the coefficients a and of the parameters that all frames share (`Chain`) follows by Gauss-Newton
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

import numpy as np
from scipy import linalg
from scipy.interpolate import BSpline
from scipy.optimize import minimize_scalar

from mjfish.data.importers.chain import Chain
from mjfish.data.validation import beat_columns, residual
from mjfish.errors import InputError
from mjfish.numerics.arrays import BoolArray, FloatArray, readonly
from mjfish.numerics.block_angular import IntArray

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
        """Return the functions (order 0) or their rates (order 1), .. at the times: (n, size)."""
        columns = [_evaluated(self.time.tobytes(), self.knots.tobytes(), order)]
        for k in range(1, self.harmonics + 1):
            omega = 2.0 * np.pi * k * float(beat or 0.0)
            phase = omega * (self.time - self._middle) + 0.5 * np.pi * order
            columns.append(omega**order * np.column_stack([np.cos(phase), np.sin(phase)]))
        return np.concatenate(columns, axis=1)

    def stretched(self, beat: float | None, order: int = 0) -> FloatArray:
        """Return the derivative (n, size) of the functions, or of their rates, by the logarithm of the beat."""
        slope = self.design(beat, order + 1) * (self.time - self._middle)[:, None] + order * self.design(beat, order)
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
    """The normal equations at one state: the covariance of all unknowns that they give, and what they were made of.

    `slopes`: (n, points, d, k) derivatives by the coordinates of the frame and by what all frames share, the logarithm
    of the beat last.
    """

    covariance: FloatArray
    right: FloatArray
    residual: FloatArray
    slopes: FloatArray
    design: FloatArray

    @classmethod
    def of(cls, seen: Chain, basis: Basis, state: State, weight: FloatArray, rough: FloatArray) -> System:
        """Linearise at a state, with weights (n, points) and the roughness (size, size) of the basis."""
        design = basis.design(state.beat)
        count, size = state.coefficients.shape
        value, slopes = seen.at(design @ state.coefficients.T, state.shared)
        residual = np.where(weight[..., None] > 0.0, seen.measured - value, 0.0)
        if state.beat is not None:
            rate = basis.stretched(state.beat) @ state.coefficients.T
            slopes = np.concatenate([slopes, np.einsum("npdi,ni->npd", slopes[..., :count], rate)[..., None]], axis=3)
        weighted = slopes * (weight / np.square(state.sigma))[..., None, None]
        gram = np.einsum("npdi,npdj->nij", weighted, slopes, optimize=True)
        pull = np.einsum("npdi,npd->ni", weighted, residual, optimize=True)
        normal, right = _belief(seen, basis, state, rough)
        own = count * size
        for i in range(count):
            for j in range(i + 1):  # the lower triangle is all that is read
                block = design.T @ (gram[:, i, j, None] * design)
                normal[i * size : (i + 1) * size, j * size : (j + 1) * size] += block
        mixed = np.einsum("nik,na->kia", gram[:, :count, count:], design, optimize=True)
        normal[own:, :own] += mixed.reshape(-1, own)
        normal[own:, own:] += gram[:, count:, count:].sum(axis=0)
        right += np.concatenate([(pull[:, :count].T @ design).ravel(), pull[:, count:].sum(axis=0)])
        factor, _ = linalg.cho_factor(normal, lower=True)
        lower, _ = linalg.lapack.dpotri(factor, lower=True)
        covariance = np.asarray(np.tril(lower) + np.tril(lower, -1).T)
        return cls(covariance, right, residual, slopes, design)

    def step(self, state: State) -> tuple[State, float]:
        """Return the state after a Gauss-Newton step and its length in units of its own uncertainty."""
        move = self.covariance @ self.right
        own, shared = np.split(move, [state.coefficients.size])
        beat = state.beat
        if beat is not None:
            beat *= float(np.exp(np.clip(shared[-1], -_BEAT, _BEAT)))
            shared = shared[:-1]
        moved = float(np.sqrt(abs(move @ self.right) / len(move)))
        coefficients = state.coefficients + own.reshape(state.coefficients.shape)
        return replace(state, beat=beat, coefficients=coefficients, shared=state.shared + shared), moved


def _belief(seen: Chain, basis: Basis, state: State, rough: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return what is believed of coefficients, of what is shared and of the beat, as normal equations."""
    design = basis.design(state.beat)
    gram = (1 + 2 * basis.harmonics) / len(design) * design.T @ design
    smooth = np.kron(np.diag(1.0 / state.intensity), rough) + np.kron(seen.form, gram)
    np.fill_diagonal(smooth, smooth.diagonal() + 1.0 / _WIDE**2)
    beat = [] if state.beat is None else [0.0]
    widths = np.append(seen.belief, [_BEAT for _ in beat])
    normal = linalg.block_diag(smooth, np.diag(1.0 / np.square(widths)))
    return normal, -normal @ np.concatenate([state.coefficients.ravel(), state.shared, beat])


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


def noise_by_evidence(system: System, weight: FloatArray, state: State) -> FloatArray:
    """Return the noise of the points (points,) that maximises the evidence."""
    by_frame = _by_frame(system, *state.coefficients.shape)
    leverage = np.einsum("npdi,nij,npdj->np", system.slopes, by_frame, system.slopes, optimize=True)
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


def _by_frame(system: System, count: int, size: int) -> FloatArray:
    """Return the covariance of coordinates and shared, frame by frame (n, k, k)."""
    design, shared = system.design, system.slopes.shape[3] - count
    # Row for row what a coordinate of a frame is made of; what is shared is made of itself.
    half = np.einsum("na,iak->nik", design, system.covariance[: count * size].reshape(count, size, -1), optimize=True)
    found = np.empty((len(design), count + shared, count + shared))
    own = half[..., : count * size].reshape(-1, count, count, size)
    found[:, :count, :count] = np.einsum("nijb,nb->nij", own, design, optimize=True)
    found[:, :count, count:] = half[..., count * size :]
    found[:, count:, :count] = found[:, :count, count:].transpose(0, 2, 1)
    found[:, count:, count:] = system.covariance[count * size :, count * size :]
    return found


def intensity_by_evidence(
    state: State, covariance: FloatArray, rough: FloatArray, basis: Basis, kinds: IntArray, first: FloatArray
) -> FloatArray:
    """Return the intensities (coordinates,) that maximise the evidence, one for each kind."""
    own, alike = state.coefficients, np.equal.outer(kinds, kinds)
    blocks = covariance[: own.size, : own.size].reshape(own.shape * 2)
    rank = float(basis.splines - 3)
    squares = np.einsum("ia,ab,ib->i", own, rough, own) / state.intensity
    known = rank - np.einsum("ab,iaib->i", rough, blocks) / state.intensity
    every = rank * alike.sum(axis=1)
    held = _HELD * _LOW * (alike @ (first / state.intensity)) / alike.sum(axis=1)
    # The step of expectation maximisation, which is safe, lengthened where the data know few of the coefficients.
    ratio = (alike @ (squares + rank - known) + held) / (every + _HELD)
    longer = np.minimum(every / np.maximum(alike @ known, 1.0), _LONGEST)
    return np.asarray(np.clip(state.intensity * ratio**longer, _LEAST * first, _MOST * first))


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
            rows[:, -1] = self.basis.stretched(self.beat, order) @ self.coefficients[coordinate]
        return rows


def smooth(seen: Chain, basis: Basis, beat: float | None, start: FloatArray, sigma: float) -> Fit:
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
        return _smoothed(seen, basis, beat, start, sigma)
    except (FloatingPointError, np.linalg.LinAlgError) as error:
        raise InputError(
            f"cannot be smoothed ({error}), expected the path of a swimming fish; look for numbers or times far off"
        ) from None


@np.errstate(over="raise", divide="raise", invalid="raise")
def _smoothed(seen: Chain, basis: Basis, beat: float | None, start: FloatArray, sigma: float) -> Fit:
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
        before = state
        if number:  # a first step comes before any judgement of the noise
            state = replace(
                state,
                sigma=noise_by_evidence(system, weight, state),
                intensity=intensity_by_evidence(state, system.covariance, rough, basis, seen.kinds, first),
            )
        state, moved = system.step(state)
        weight = _weights(seen, basis, state, there, student=number < _ROBUST)
        noise = np.abs(np.log(state.sigma / before.sigma)).max()
        smoothness = np.abs(np.log(state.intensity / before.intensity)).max() / 6.0  # its sixth root is a frequency
        if number > _ROBUST and moved < _MOVED and max(noise, smoothness) < _CONVERGED:
            break
    system = System.of(seen, basis, state, weight, rough)
    return Fit(
        state.beat, state.coefficients, state.shared, state.sigma, state.intensity, basis, np.asarray(weight > 0.0),
        system.covariance, _residual(seen, basis, state), correlation_frames(system.residual),
    )  # fmt: skip


def _residual(seen: Chain, basis: Basis, state: State) -> FloatArray:
    """Return measured minus fitted, of points that do not count too."""
    return np.asarray(seen.measured - seen.at(basis.design(state.beat) @ state.coefficients.T, state.shared)[0])


def _weights(seen: Chain, basis: Basis, state: State, there: BoolArray, *, student: bool) -> FloatArray:
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
    span = max(float(np.ptp(time)), 1e-9)
    share = (time - time[0]) / span

    def sum_of_squares(trial: float, harmonics: int = 1) -> float:
        return float(np.square(residual(beat_columns(share, trial * span, harmonics), lateral)).sum())

    slowest, step = max(SLOWEST, 1.0 / span), 0.1 / span
    trials = np.arange(slowest, FASTEST, step)
    best = float(trials[int(np.argmin([sum_of_squares(trial) for trial in trials]))])
    refined = float(
        minimize_scalar(sum_of_squares, bounds=(max(best - step, 0.5 * slowest), best + step), method="bounded").x
    )
    periodic = sum_of_squares(refined, 2) < (1.0 - _PERIODIC) * max(sum_of_squares(refined, 0), 1e-300)
    return refined, periodic
