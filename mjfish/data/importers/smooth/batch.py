"""The fit: all coordinates of all frames at once, Gauss-Newton inside, evidence outside.

Posterior of the coefficients a (`basis`) and of what the frames share (`observation`), by Gauss-Newton steps on

    sum_points w |u - u(a)|^2 / sigma_m^2 + sum_c a_c' R a_c / q_c + beliefs

The noise sigma_m of every point and the intensity q_c of every coordinate maximise the evidence ([MacKay1992]):

    sigma_m^2 = tau sum w r^2 / (d n_m - leverage_m),   q_c = (a_c' R a_c + trace(R C_cc)) / rank R

Errors of tracking wander, and a smooth motion meets the spectral density of the noise at low frequencies: tau, the
median over the points of 1 + 2 sum of the residual's autocorrelations, is how many times that is that of white noise.

First w are the weights of a Student distribution of 4 degrees of freedom, so that lost and stuck points do not pull;
then points within four sigma count fully and all others not at all, so that the covariance is that of Gaussian noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mjfish.arrays import BoolArray, FloatArray
from mjfish.data.importers.smooth import evidence
from mjfish.data.importers.smooth.basis import Basis
from mjfish.data.importers.smooth.observation import Observation
from mjfish.data.importers.smooth.system import State, System

#: Degrees of freedom of the Student weights; points farther than so many sigma do not count in the end.
_STUDENT, _GATE = 4.0, 4.0
_ROBUST, _PASSES = 7, 12
#: The passes end where noise and smoothness have settled and no unknown moves by more than this share of its own sigma.
_MOVED = 0.05


@dataclass(frozen=True, eq=False)
class Fit:
    """Coordinates over time and what is known of their errors.

    Attributes:
        basis: the functions.
        beat: [Hz], None without harmonics.
        coefficients: (coordinates, size) of the functions.
        shared: what all frames share.
        sigma: (points,) noise of each point in each of its d directions.
        kept: (n, points) which points count.
        intensity: (coordinates,) of the splines' prior.
        covariance: of coefficients, shared and the logarithm of the beat, in this order.
        residual: (n, points, d) measured minus fitted; NaN where nothing was measured.
        frames: (points,) how many frames the errors of a point stay alike.
    """

    basis: Basis
    beat: float | None
    coefficients: FloatArray
    shared: FloatArray
    sigma: FloatArray
    kept: BoolArray
    intensity: FloatArray
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


def fit(seen: Observation, basis: Basis, beat: float | None, start: FloatArray, sigma: float) -> Fit:
    """Fit coordinates to what was seen.

    Args:
        seen: points and how they follow from coordinates.
        basis: functions of time at the frames.
        beat: to begin with [Hz]; None without harmonics.
        start: (n, coordinates) to begin with.
        sigma: of the points, to begin with; rather too large.
    """
    measured = seen.measured
    there: BoolArray = np.asarray(np.isfinite(measured).all(axis=2))
    rough = np.pad(basis.roughness(), (0, basis.size - basis.splines))
    first = evidence.first_intensity(start, seen.kinds, beat)
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
                sigma=evidence.noise(system, covariance, weight, state),
                intensity=evidence.intensity(state, covariance, rough, basis, seen.kinds, first),
            )
        state, moved = system.step(state, covariance)
        weight = _weights(seen, basis, state, there, student=number < _ROBUST)
        if number > _ROBUST and moved < _MOVED and evidence.settled(before, state):
            break
    system = System.of(seen, basis, state, weight, rough)
    covariance = system.covariance()
    return Fit(
        basis, state.beat, state.coefficients, state.shared, state.sigma, np.asarray(weight > 0.0), state.intensity,
        covariance, _residual(seen, basis, state), evidence.frames_alike(system.residual),
    )  # fmt: skip


def _residual(seen: Observation, basis: Basis, state: State) -> FloatArray:
    """Return measured minus fitted, of points that do not count too."""
    return np.asarray(seen.measured - seen.at(basis.design(state.beat) @ state.coefficients.T, state.shared).value)


def _weights(seen: Observation, basis: Basis, state: State, there: BoolArray, *, student: bool) -> FloatArray:
    value = seen.at(basis.design(state.beat) @ state.coefficients.T, state.shared).value
    off = np.nan_to_num(np.square(seen.measured - value).sum(axis=2), nan=np.inf) / np.square(state.sigma)
    directions = value.shape[2]
    if student:
        return np.asarray(np.where(there, (_STUDENT + directions) / (_STUDENT + off), 0.0))
    return np.asarray((off < _GATE**2 + directions).astype(np.float64))
