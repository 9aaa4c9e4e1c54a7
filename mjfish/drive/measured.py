"""Measured joint angles as a drive: a penalised quintic spline, differentiated exactly.

A cubic smoothing spline loses one to three per cent of the acceleration at five samples a radian of beat phase; the
quintic one, penalised on its third derivative (the smoothing spline of order 6), a tenth of that. The penalty is
chosen for each joint by generalised cross-validation ([Wahba1990], ch. 4), in which a degree of freedom of the spline
costs 1.4 of them: plain cross-validation now and then takes white noise for motion [KimGu2004].

That is the best guess of an angle, and it takes the third harmonic of a beat for noise. Where the errors of the angles
are allowed for (`mjfish.estimation.sensor_noise`), noise that is left does no harm, and what is missing in every beat
does: the penalty is a share of it then. Tests of what a fit leaves still derive along the best guess
(`mjfish.estimation.Problem.smoother`).

[KimGu2004] Y.-J. Kim and C. Gu, Journal of the Royal Statistical Society B 66.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import linalg, optimize, sparse
from scipy.interpolate import BSpline, make_interp_spline
from scipy.ndimage import maximum_filter1d

from mjfish.drive.motion import JointMotion, grid
from mjfish.numerics.arrays import FloatArray

_DEGREE = 5
#: Log10 of the penalty, relative to its natural scale, between interpolation and the strongest smoothing searched.
_SEARCH = (-9.0, 4.0)
#: What a degree of freedom costs.
_DEAR = 1.4
#: Share of the penalty of cross-validation where errors are allowed for: the bandwidth grows by a factor of 1.8. The p
#: values of five datasets with nothing hidden (joints to 0.05 to 0.5 degrees) are 0.05, 0.11, 0.47, 0.08, 0.46 at 1/8;
#: 0.45, 0.93, 0.82, 0.20, 0.49 at 1/32; and as good at 1/128, where noise of joints to 0.5 degrees begins to drag.
ALLOWED = 1.0 / 32.0
#: Sigma of samples without noise, for the smoother divides by it [rad].
_EXACT = 1e-6
#: Posterior standard deviation in the middle between exact samples one apart, under unit intensity of the third
#: derivative (the posterior of the interpolating spline).
_MIDDLE = 0.02603
#: Multiple of m_2 m_2 / m_4 that is said, and the share of the standard deviation from which on m_4 tells nothing (see
#: `exact`). With 8, all of 53 films with nothing hidden and commanded joints pass, and the least p is 0.011; with 5.5,
#: two of the first ten have p = 0.005 in one of the tests.
_ALIKE, _LOST = 8.0, 0.5
#: A joint changes abruptly where a spline of every second sample misses a sample by this many sigma; noise alone misses
#: it by 1.4, rms. Of film 996 it finds 4 to 20 samples in records with an abrupt change, none in the others.
_STANDS_OUT = 6.0
#: Steps of the first and the second derivative with respect to log10 of the penalty.
_DIFFERENCE, _SECOND = 5e-3, 0.05


def joint_motion(time: FloatArray, angle: FloatArray, step: float, *, late: float = 0.0) -> JointMotion:
    """Smooth recorded joint angles and sample the joint motion on the half-step grid.

    Args:
        time: (n,) increasing [s].
        angle: (n, joints) measured [rad].
        step: longest integration step [s].
        late: by how much the joints are behind the record [s]; where they begin they stand still as long.
    """
    return sampled([smoothing_spline(time, column) for column in angle.T], time, step, late=late)


def sampled(splines: Sequence[BSpline], time: FloatArray, step: float, *, late: float = 0.0) -> JointMotion:
    """Sample splines of all joints on the half-step grid; arguments as in `joint_motion`."""
    boundaries = grid(np.array([time[0], time[-1]]), step)
    stages = np.stack([boundaries[:-1], 0.5 * (boundaries[:-1] + boundaries[1:]), boundaries[1:]], axis=1)
    motion = [
        np.stack([spline(np.maximum(stages - late, time[0]), nu=order) for spline in splines], axis=-1)
        for order in range(3)
    ]
    return JointMotion(time=boundaries, angle=motion[0], rate=motion[1], acceleration=motion[2])


def smoothing_spline(time: FloatArray, signal: FloatArray) -> BSpline:
    """Return the spline of `smoothing`, quintic with a knot at every sample."""
    return smoothing(time, signal).spline


@dataclass(frozen=True, eq=False)
class Smoothed:
    """A smoothed signal.

    Attributes:
        spline: of the signal.
        sigma: of the white noise that was smoothed away, [unit of the signal].
        intensity: (n - 1,) of the white third derivative that the signal has between two samples.
    """

    spline: BSpline
    sigma: float
    intensity: FloatArray


@dataclass(frozen=True, eq=False)
class Smoothing(Smoothed):
    """A smoothed signal, and how the same smoothing changes others; large.

    Attributes:
        design: (n, size) basis functions at the samples.
        bands: of the normal matrix with the penalty, in the layout of `scipy.linalg.solveh_banded`.
        degrees_of_freedom: of the spline, the trace of its hat matrix.
    """

    design: sparse.csr_array
    bands: FloatArray
    degrees_of_freedom: float

    def of(self, columns: FloatArray) -> BSpline:
        """Smooth columns (n, k) with the penalty that the signal was smoothed with."""
        return BSpline(self.spline.t, linalg.solveh_banded(self.bands, self.design.T @ columns), _DEGREE)


def smoothing(time: FloatArray, signal: FloatArray, share: float = 1.0, ease: FloatArray | float = 1.0) -> Smoothing:
    """Fit f minimising sum (f(t_j) - y_j)^2 + lam INT f'''^2 / ease dt, lam a share of that of cross-validation.

    The variance of the noise is sum (f(t_j) - y_j)^2 / tr (1 - H)^2 with the hat matrix H, unbiased at any lam.

    Args:
        time: (n,) increasing, n > 6 [s].
        signal: (n,).
        share: of the penalty.
        ease: (n - 1,) how many times less the penalty is between two samples, or one number for all.
    """
    knots = make_interp_spline(time, np.zeros_like(time), k=_DEGREE).t
    design = BSpline.design_matrix(time, knots, _DEGREE)
    roughness = _roughness(knots, BSpline(time, np.broadcast_to(ease, len(time) - 1), 0))
    normal = (design.T @ design).tocsr()
    scale = normal.diagonal().sum() / roughness.diagonal().sum()
    right = np.asarray(design.T @ signal)
    normal_bands, rough_bands = _bands(normal), _bands(roughness)
    n, worst = len(signal), 1e12 * float(signal @ signal)

    def bands(log_penalty: float) -> FloatArray:
        return np.asarray(normal_bands + 10.0**log_penalty * scale * rough_bands)

    def log_determinant(log_penalty: float) -> float:
        return 2.0 * float(np.sum(np.log(linalg.cholesky_banded(bands(log_penalty))[-1])))

    def residual_degrees_of_freedom(log_penalty: float) -> float:
        """Return n - tr H = d log det(N + lam R) / d log lam, banded and so linear in n."""
        rise = log_determinant(log_penalty + _DIFFERENCE) - log_determinant(log_penalty - _DIFFERENCE)
        return max(float(rise / (2.0 * _DIFFERENCE * np.log(10.0))), 1e-9 * n)

    def fitted(log_penalty: float) -> tuple[FloatArray, float]:
        """Return the coefficients and the sum of squares."""
        coefficients = linalg.solveh_banded(bands(log_penalty), right)
        residual = signal - design @ coefficients
        return coefficients, float(residual @ residual)

    def score(log_penalty: float) -> float:
        dear = n - _DEAR * (n - residual_degrees_of_freedom(log_penalty))
        # Where the spline costs more than there is, the score falls towards where it does not.
        return n * fitted(log_penalty)[1] / dear**2 if dear > 0.0 else worst * (2.0 - dear / n)

    best = optimize.minimize_scalar(score, bounds=_SEARCH, method="bounded", options={"xatol": 0.05})
    penalty = float(best.x) + np.log10(share)
    coefficients, squares = fitted(penalty)
    # tr (1 - H)^2 = (1 - d / d log lam) tr (1 - H)
    bend = (residual_degrees_of_freedom(penalty + _SECOND) - residual_degrees_of_freedom(penalty - _SECOND)) / (
        2.0 * _SECOND * np.log(10.0)
    )
    free = residual_degrees_of_freedom(penalty)
    sigma = float(np.sqrt(squares / max(free - bend, 1e-9 * n)))
    intensity = np.full(n - 1, sigma**2 / (10.0**penalty * scale)) * ease
    return Smoothing(BSpline(knots, coefficients, _DEGREE), sigma, intensity, design, bands(penalty), n - free)


def eased_smoothing(time: FloatArray, signal: FloatArray, share: float) -> Smoothing:
    """Smooth a signal, less so where it changes abruptly.

    A spline of every second sample misses an abrupt change by far more than noise explains. There, the intensity of the
    third derivative is the one under which such a miss is one standard deviation. Elsewhere it is one number.

    Args:
        time: (n,) increasing, n > 6 [s].
        signal: (n,).
        share: of the penalty.
    """
    first, missed = smoothing(time, signal, share), _missed(time, signal, 2)
    beyond = np.where(missed > _STANDS_OUT * first.sigma, missed, 0.0)
    if not beyond.any():
        return first
    return smoothing(time, signal, share, np.maximum(_intensity(time, beyond) / first.intensity, 1.0))


def exact(time: FloatArray, signal: FloatArray) -> Smoothed:
    """Interpolate a signal whose samples have no noise, and say how well it is known between them.

    The spline is the natural one: of all curves through the samples it has the least INT f'''^2 dt [Wahba1990]. In the
    middle between two samples its error is at most m_2, that of a spline of every second sample there. The spline of
    every fourth sample has the error m_4. A smooth signal has an error below m_2 m_2 / m_4. Eight times that is said,
    if it is less than m_2, for an error in a beat is the same in every beat. Where the signal steps, m_2 = m_4, and m_2
    is said; so it is where the spline of every fourth sample misses the beat itself.

    Args:
        time: (n,) increasing, n > 6 [s].
        signal: (n,).
    """
    missed, coarse = _missed(time, signal, 2), _missed(time, signal, 4)
    smooth = coarse < _LOST * np.std(signal)
    missed *= np.where(smooth, np.minimum(_ALIKE * missed / np.maximum(coarse, _EXACT), 1.0), 1.0)
    return Smoothed(_natural(time, signal), _EXACT, _intensity(time, np.hypot(missed, _EXACT)))


def _intensity(time: FloatArray, missed: FloatArray) -> FloatArray:
    """Return the intensity between samples (n - 1,) under which what is missed (n,) is one standard deviation."""
    return np.asarray(0.5 * (missed[:-1] ** 2 + missed[1:] ** 2) / (_MIDDLE**2 * np.diff(time) ** 5))


def _missed(time: FloatArray, signal: FloatArray, every: int) -> FloatArray:
    """Return by how much splines of every so many samples miss those in their middles, or those beside them (n,)."""
    missed = np.full(len(signal), np.inf)
    for first in range(every if len(signal) >= 3 * every else 0):  # a natural spline has three points or more
        used, left = slice(first, None, every), slice((first + every // 2) % every, None, every)
        missed[left] = _natural(time[used], signal[used])(time[left]) - signal[left]
    ends = every // 2  # an end is no better than what is beside it
    return np.asarray(maximum_filter1d(np.pad(np.abs(missed[ends:-ends]), ends, mode="edge"), 3, mode="nearest"))


def _natural(time: FloatArray, signal: FloatArray) -> BSpline:
    ends: Any = [(3, 0.0), (4, 0.0)]
    return make_interp_spline(time, signal, k=_DEGREE, bc_type=(ends, ends))


def _roughness(knots: FloatArray, ease: BSpline) -> sparse.csr_array:
    """Return INT B_i''' B_j''' / ease dt: piecewise quartic, so three Gauss points a knot interval are exact."""
    ends = np.unique(knots)
    points, weights = np.polynomial.legendre.leggauss(3)
    half = 0.5 * np.diff(ends)
    at = (0.5 * (ends[:-1] + ends[1:]) + half * points[:, None]).T.ravel()
    weight = (half * weights[:, None]).T.ravel() / ease(at)
    third = BSpline.design_matrix(at, knots[3:-3], _DEGREE - 3)
    for degree in range(_DEGREE - 2, _DEGREE + 1):  # coefficients of a derivative: scaled differences
        t = knots[_DEGREE - degree : len(knots) - _DEGREE + degree]
        steps = degree / (t[degree + 1 : -1] - t[1 : -degree - 1])
        diagonals = np.stack([np.append(-steps, 0.0), np.insert(steps, 0, 0.0)])
        third = sparse.csr_array(
            third @ sparse.dia_array((diagonals, np.array([0, 1])), shape=(len(steps), len(steps) + 1))
        )
    return sparse.csr_array(third.T @ sparse.diags_array(weight) @ third)


def _bands(matrix: sparse.csr_array) -> FloatArray:
    """Return the upper bands of a symmetric banded matrix in the layout of `scipy.linalg.solveh_banded`."""
    bands = np.zeros((_DEGREE + 1, matrix.shape[0]))
    for offset in range(_DEGREE + 1):
        bands[_DEGREE - offset, offset:] = matrix.diagonal(offset)
    return bands
