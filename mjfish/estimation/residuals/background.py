"""The noise beside the lines: autoregressive noise of residuals in which the input may have left its own frequencies.

Regressing residuals on a basis B takes the lines out, but also the noise that was there; a notch is left. Its noise is
put back as the model expects it, and model and notch are brought to agree: with P = I - B B', the autocovariances are
those of

    E[v v' | P v] = P v v' P + B (B' S B) B',     S the covariance of the model so far

(an EM step that drops what P v says of B'v, [Dempster1977]). The Yule-Walker equations then give the next model.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import signal

from mjfish.arrays import FloatArray
from mjfish.estimation.noise import Noise, by_order, highest_order, lagged_products

#: Rounds until model and notch agree: the notch is a small part, every round gains a digit or more.
_ROUNDS = 4
#: Samples before the first over which a noise model is continued: its memory.
_MEMORY = 400


def background(residuals: Sequence[FloatArray], bases: Sequence[FloatArray], lost: float = 0.0) -> Noise:
    """Estimate the noise of trials of one sampling rate, beside the span of a basis in each.

    Args:
        residuals: (m, 3) a trial, on a grid of equal intervals, NaN in gaps.
        bases: (m, d) orthonormal, zero in the gaps.
        lost: further degrees of freedom a channel that a fit took.
    """
    total = sum(int(np.all(np.isfinite(block), axis=1).sum()) for block in residuals)
    highest = highest_order([len(block) for block in residuals])
    cleared = [
        (e := np.nan_to_num(block)) - basis @ (basis.T @ e) for block, basis in zip(residuals, bases, strict=True)
    ]
    noise = Noise.white(np.sqrt(lagged_products(cleared, 0)[:, 0] / total) + 1e-150)
    for _ in range(_ROUNDS):
        products = lagged_products(cleared, highest)
        for c in range(3):
            products[c] += sum(_expected(noise, c, basis, highest) for basis in bases)
        noise = by_order(products / max(total - lost, 0.1 * total), total)
    return noise


def coloured(noise: Noise, channel: int, columns: FloatArray) -> FloatArray:
    """Return sigma A^-T u of columns u (m, d): the noise filter backwards in time, on past the first sample.

    The product of two of them is u' S u, S the covariance of the noise.
    """
    if noise.order == 0:
        return np.asarray(noise.sigma[channel] * columns)
    longer = np.concatenate([np.zeros((_MEMORY, columns.shape[1])), columns])
    denominator = np.concatenate([[1.0], -noise.phi[channel]])
    return np.asarray(signal.lfilter([noise.sigma[channel]], denominator, longer[::-1], axis=0))


def _expected(noise: Noise, channel: int, basis: FloatArray, highest: int) -> FloatArray:
    """Return the lagged products (highest + 1,) that the noise has in the span of a basis."""
    shaped = coloured(noise, channel, basis)
    spread = basis @ (shaped.T @ shaped)
    return np.array([np.sum(spread[k:] * basis[: len(basis) - k]) for k in range(highest + 1)])
