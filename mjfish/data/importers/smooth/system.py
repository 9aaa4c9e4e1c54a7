"""The normal equations of the fit at one state, block by block: points of a frame, basis of a coordinate."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg

from mjfish.arrays import FloatArray
from mjfish.data.importers.smooth.basis import Basis
from mjfish.data.importers.smooth.observation import Linearised, Observation

#: Belief about every coefficient [m or rad]: wide; and about the logarithm of the beat.
_WIDE, _BEAT = 30.0, 0.05


@dataclass(frozen=True, eq=False)
class State:
    """Where the fit stands; see `mjfish.data.importers.smooth.batch.Fit`."""

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
    own: FloatArray
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
        weighted = here.own * scaled[..., None, None]
        own = np.einsum("npdi,npdj->nij", weighted, here.own, optimize=True)
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
        return cls(normal, right, residual, here.own, shared, design)

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
    return np.concatenate([here.shared, np.einsum("npdi,ni->npd", here.own, rate)[..., None]], axis=3)


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
