"""Pose of the head from its three markers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.importers.fishsim.markers import HEAD, STATIONS

#: var of the third difference of white noise, in units of its variance: 1 + 9 + 9 + 1.
_THIRD_DIFFERENCE = 20.0


@dataclass(frozen=True, eq=False)
class HeadTrack:
    """The rigid head, frame by frame.

    Attributes:
        pose: (n, 3) x, y [m] of the nose and yaw [rad] of the forward direction, as measured.
        residual: (n, 3, 2) what the rigid head leaves of the markers, world [m].
        weight: (3,) of the markers in the fit; 1 for the pair.
    """

    pose: FloatArray
    residual: FloatArray
    weight: FloatArray


def track(position: FloatArray) -> HeadTrack:
    """Fit the rigid head to its markers by weighted least squares in each frame.

    Markers 0 and 1 define the head. Marker 2 sits 0.05 m higher and 0.2 m behind, which trebles the baseline for yaw
    but shifts it by parallax. The shift, and its drift as the fish crosses the image, are estimated in the world and
    removed; what then remains against the pair sets its weight, so that it helps where it agrees and is all but
    ignored where it does not.

    Args:
        position: (n, 3, 2) of markers 0 to 2 [m].
    """
    station = STATIONS[list(HEAD)]
    weight = np.ones(len(HEAD))
    weight[2] = 0.0
    pose = _fit(position, station, weight)
    astray = position[:, 2] - _place(pose, station[2:])[:, 0]
    share = np.linspace(-1.0, 1.0, len(position))
    drift = np.stack([np.ones_like(share), share], axis=1)
    shift = drift @ np.linalg.lstsq(drift, astray)[0]
    noise = np.square(np.diff(position[:, :2], n=3, axis=0)).mean() / _THIRD_DIFFERENCE
    # Extrapolated from the pair: the noise of its middle, and that of its direction times the lever.
    lever = (station[2] - station[:2].mean()) / (station[1] - station[0])
    excess = np.square(astray - shift).mean() - noise * (0.5 + lever**2)
    weight[2] = noise / max(excess, noise)
    corrected = position.copy()
    corrected[:, 2] -= shift
    pose = _fit(corrected, station, weight)
    return HeadTrack(pose, corrected - _place(pose, station), weight)


def _fit(position: FloatArray, station: FloatArray, weight: FloatArray) -> FloatArray:
    """Return the pose (n, 3) of the nose: the closed form of the planar Procrustes fit to points on a line."""
    share = weight / weight.sum()
    middle = np.einsum("m,nmi->ni", share, position)
    centre = float(share @ station)
    towards_tail = np.einsum("m,nmi->ni", share * (station - centre), position - middle[:, None])
    towards_tail /= np.hypot(*towards_tail.T)[:, None]
    yaw = np.unwrap(np.arctan2(-towards_tail[:, 1], -towards_tail[:, 0]))
    return np.column_stack([middle - centre * towards_tail, yaw])


def _place(pose: FloatArray, station: FloatArray) -> FloatArray:
    """Return where points of the head at `station` (m,) are: (n, m, 2) [m]."""
    forward = np.stack([np.cos(pose[:, 2]), np.sin(pose[:, 2])], axis=1)
    return np.asarray(pose[:, None, :2] - station[:, None] * forward[:, None])


def nose_covariance(weight: FloatArray) -> FloatArray:
    """Return the covariance of the fitted surge, sway, yaw at the nose for unit variance of a marker of weight 1.

    (J^T W J)^-1 with rows (1, 0, 0) and (0, 1, -s) for a marker at station s.

    Returns:
        (3, 3) [m2, m2, rad2 and mixed, per m2].
    """
    station = STATIONS[list(HEAD)]
    one, first, second = weight.sum(), weight @ station, weight @ station**2
    normal = np.array([[one, 0.0, 0.0], [0.0, one, -first], [0.0, -first, second]])
    return np.asarray(np.linalg.inv(normal))
