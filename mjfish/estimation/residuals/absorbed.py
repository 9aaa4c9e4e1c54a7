"""What a fit takes out of the noise: the residual is orthogonal to the sensitivities, in the metric of the weights.

With prediction yhat = J x near the estimate, whitening filter F and weights W = F'F, the residual of noise v is

    e = (I - J (J'W J)^+ J'W) v,      so      u'e = (u - W J (J'W J)^+ J'u)' v
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from scipy import signal

from mjfish.arrays import BoolArray, FloatArray
from mjfish.estimation.fit import Fit
from mjfish.estimation.noise import Noise
from mjfish.estimation.problem import Problem

#: Directions in parameter space that the data move less than this, relative to the strongest, take nothing out.
_FLOOR = 1e-9


@dataclass(frozen=True, eq=False)
class Absorbed:
    """The sensitivities of a fit, ready to clear columns of them.

    Attributes:
        noise: that made the weights.
        masks: (n_r,) samples of every trial that the fit looked at.
        starts: where, among those, a stretch without a missing sample begins.
        slopes: (n_r', 3, p) of every trial, at those samples, scaled.
        left: (n', k) orthonormal basis of F J.
        map: (p, k): F J map = left.
    """

    noise: Noise
    masks: tuple[BoolArray, ...]
    starts: tuple[tuple[int, ...], ...]
    slopes: tuple[FloatArray, ...]
    left: FloatArray
    map: FloatArray

    def clear(self, columns: list[FloatArray]) -> list[FloatArray]:
        """Return u - W J (J'W J)^+ J'u of columns u, given as blocks (n_r, 3, d), one a trial."""
        inside = [block[mask] for block, mask in zip(columns, self.masks, strict=True)]
        along = sum(np.einsum("ncp,ncd->pd", j, u) for j, u in zip(self.slopes, inside, strict=True))
        taken = self.left @ (self.map.T @ along)
        result, first = [], 0
        for block, mask, starts, u in zip(columns, self.masks, self.starts, inside, strict=True):
            cleared, pieces = block.copy(), []
            for begin, end in itertools.pairwise([*starts, len(u)]):
                last = first + 3 * max(end - begin - self.noise.order, 0)
                pieces.append(_unwhiten(self.noise, taken[first:last].reshape(-1, 3, block.shape[2]), end - begin))
                first = last
            cleared[mask] -= np.concatenate(pieces)
            result.append(cleared)
        return result


def absorbed(problem: Problem, fit: Fit) -> Absorbed:
    """Return what `fit` took out of the residuals of `problem`: directions of parameters off their bounds."""
    free = np.flatnonzero(~fit.at_bound)
    slopes = [block[:, :, free] for block in problem.sensitivities(fit.x)]
    size = np.sqrt(np.maximum(np.sum(problem.whiten(slopes) ** 2, axis=0), 1e-300))
    slopes = [block / size for block in slopes]
    left, singular, right = np.linalg.svd(problem.whiten(slopes), full_matrices=False)
    kept = singular > _FLOOR * singular.max(initial=0.0)
    masks = tuple(problem.mask(i) for i in range(len(problem.trials)))
    starts = tuple(tuple(problem.stretches(i)) for i in range(len(problem.trials)))
    return Absorbed(problem.noise, masks, starts, tuple(slopes), left[:, kept], right[kept].T / singular[kept])


def _unwhiten(noise: Noise, block: FloatArray, samples: int) -> FloatArray:
    """Apply the transpose of whitening to one stretch, (m, 3, d) to (samples, 3, d): the filter, backwards in time."""
    if noise.order == 0:
        return np.asarray(block / noise.sigma[:, None])
    padded = np.concatenate([np.zeros((samples - len(block), *block.shape[1:])), block])
    channels = [
        signal.lfilter(np.concatenate([[1.0], -noise.phi[c]]), [noise.sigma[c]], padded[::-1, c], axis=0)[::-1]
        for c in range(3)
    ]
    return np.asarray(np.stack(channels, axis=1))
