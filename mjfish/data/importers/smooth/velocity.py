"""Velocities of the nose, and what is known of their errors.

surge = cos(yaw) x' + sin(yaw) y',   sway = cos(yaw) y' - sin(yaw) x',   yaw rate = yaw'
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjfish import frames
from mjfish.arrays import FloatArray
from mjfish.data.importers.smooth.batch import Fit

#: Correlation below which errors count as independent.
_INDEPENDENT = 0.3
_X, _Y, _YAW = 0, 1, 2


@dataclass(frozen=True, eq=False)
class Velocities:
    """Velocities at the frames.

    Attributes:
        value: (n, 3) surge, sway [m/s], yaw rate [rad/s] of the nose.
        sigma: (n, 3) of their errors.
        correlation: (lags, 3) of the errors of frames so many apart, mean over the middle of the run; lag 0 first.
    """

    value: FloatArray
    sigma: FloatArray
    correlation: FloatArray

    @property
    def apart(self) -> int:
        """How many frames apart the errors of all channels are nearly independent."""
        far = np.flatnonzero((self.correlation < _INDEPENDENT).all(axis=1))
        return int(far[0]) if far.size else len(self.correlation)


def of(fit: Fit) -> Velocities:
    """Return the velocities of a fit whose first coordinates are x, y [m] and yaw [rad]."""
    yaw, rate = fit.coordinates()[:, _YAW], fit.coordinates(1)
    lags = max(len(yaw) // 4, 1)
    pairs = [_errors(slope, fit.covariance, lags) for slope in gradients(fit)]
    return Velocities(
        value=np.column_stack([frames.to_body(rate[:, :2], yaw), rate[:, _YAW]]),
        sigma=np.column_stack([sigma for sigma, _ in pairs]),
        correlation=np.column_stack([correlation for _, correlation in pairs]),
    )


def gradients(fit: Fit) -> list[FloatArray]:
    """Return the derivatives (n, unknowns) of surge, sway and yaw rate by all unknowns of a fit."""
    yaw, rate = fit.coordinates()[:, _YAW], fit.coordinates(1)
    cos, sin = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    body = frames.to_body(rate[:, :2], yaw)
    along, to_port = fit.gradient(_X, 1), fit.gradient(_Y, 1)
    turned = fit.gradient(_YAW)
    return [
        cos * along + sin * to_port + body[:, 1:] * turned,
        cos * to_port - sin * along - body[:, :1] * turned,
        fit.gradient(_YAW, 1),
    ]


def _errors(slope: FloatArray, covariance: FloatArray, lags: int) -> tuple[FloatArray, FloatArray]:
    """Return sigma (n,) and the correlation (lags,) of errors with derivatives `slope` (n, unknowns)."""
    spread = slope @ covariance
    variance = np.einsum("nu,nu->n", spread, slope)
    inner = slice(len(slope) // 8, len(slope) - len(slope) // 8)
    products = [
        float(np.einsum("nu,nu->", spread[inner][lag:], slope[inner][: len(slope[inner]) - lag]))
        / max(len(slope[inner]) - lag, 1)
        for lag in range(min(lags, len(slope[inner]) - 1))
    ]
    return np.sqrt(np.maximum(variance, 0.0)), np.asarray(products) / max(products[0], 1e-300)


def sigma_of(fit: Fit, coordinate: int) -> FloatArray:
    """Return sigma (n,) of one coordinate."""
    slope = fit.gradient(coordinate)
    return np.asarray(np.sqrt(np.maximum(np.einsum("nu,nu->n", slope @ fit.covariance, slope), 0.0)))
