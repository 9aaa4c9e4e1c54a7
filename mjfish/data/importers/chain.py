"""Markers on the chain of links, as a tilted camera above it sees them.

With points as complex numbers, k the link of marker m and psi_k its direction towards the tail,

    p_m = nose + sum_{j<k} l_j exp(i psi_j) + (r_m + along_m + i across_m) exp(i psi_k)
          + sum_g [shift_g + kappa_g (p_m - c) + i slip_g(t) exp(i psi_0)]

    u_m = c + exp(lambda) (p_m - c) / (1 + gamma . (p_m - c))

g are the planes that the marker lies in. A plane that is lower or higher than that of the first markers appears shifted
and scaled about the point under the camera (parallax), and wobbles sideways as the fish rolls; gamma is the gradient of
the scale under a tilted camera, lambda an error of the scale.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.block_angular import IntArray

ComplexArray = NDArray[np.complex128]

#: Beliefs about the error of the scale [-], its gradient [1/m], its difference by direction [-], a plane's scale [-].
SCALE, GRADIENT, OBLIQUE, PLANE = 0.02, 0.3, 0.05, 0.1
#: Numbers of the camera in front of those of the planes.
_CAMERA = 5
#: Beliefs about joint angles and their differences from joint to joint [rad]: wide; they keep a zigzag of neighbours,
#: to which the markers are nearly blind, from growing.
ANGLE, ZIGZAG = 0.5, 0.1


@dataclass(frozen=True, eq=False)
class Marked:
    """Where the markers sit; planes are those at other heights than the first ones.

    Attributes:
        names: of the markers.
        lengths: of the links [m].
        link: (markers,) on which each sits, 0 is the head.
        station: (markers,) behind the front joint of its link, along the straight fish [m].
        doubts: (markers, 2) how far it may sit from there along the link and across [m], one standard deviation.
        inside: (markers, planes) 1 where a marker lies in a plane, else 0.
        shift: (planes,) how far the markers of one may appear shifted [m], one standard deviation.
        slip: (planes,) how far they wobble sideways with the beat [m], one standard deviation.
        base: the two markers that define the head, front one first.
        behind: those on links behind the head.
        rolling: the plane whose slip measures the roll, and how far it lies below the base [m]; None: nothing does.
    """

    names: tuple[str, ...]
    lengths: FloatArray
    link: IntArray
    station: FloatArray
    doubts: FloatArray
    inside: FloatArray
    shift: FloatArray
    slip: FloatArray
    base: tuple[int, int]
    behind: tuple[int, ...]
    rolling: tuple[int, float] | None

    @property
    def joints(self) -> int:
        """Number of joints."""
        return len(self.lengths) - 1


@dataclass(frozen=True, eq=False)
class Chain:
    """Markers seen on a chain; coordinates are x, y [m], yaw [rad] of the nose, joint angles [rad], slips [m].

    Attributes:
        measured: (n, markers, 2) [m], roughly scaled; NaN where not seen.
        on: where they sit.
    """

    measured: FloatArray
    on: Marked

    @property
    def coordinates(self) -> int:
        """Number of coordinates a frame."""
        return 3 + self.on.joints + len(self.on.shift)

    @property
    def kinds(self) -> IntArray:
        """X and y, yaw, joint angles, slips (coordinates,): those of one number are equally smooth."""
        return np.array([0, 0, 1] + [2] * self.on.joints + [3] * len(self.on.shift))

    @functools.cached_property
    def belief(self) -> FloatArray:
        """Deviations from zero that are believed: scale, gradient (2), oblique (2), each plane (3), each marker (2)."""
        planes = [[shift, shift, PLANE] for shift in self.on.shift]
        camera = [SCALE, GRADIENT, GRADIENT, OBLIQUE, OBLIQUE]
        return np.concatenate([camera, *planes, *np.maximum(self.on.doubts, 1e-9)])

    def places(self, shared: FloatArray) -> FloatArray:
        """Return how far the markers sit from their stations, along and across (markers, 2) [m]."""
        return shared[_CAMERA + 3 * len(self.on.shift) :].reshape(-1, 2)

    @functools.cached_property
    def form(self) -> FloatArray:
        """Precision, once for every look, of joint angles, of their differences from joint to joint, and of slips."""
        joints = np.eye(self.on.joints)
        zigzag = np.diff(joints, axis=0)
        slips = np.diag(1.0 / np.square(np.maximum(self.on.slip, 1e-6)))
        return np.asarray(linalg.block_diag(np.zeros((3, 3)), joints / ANGLE**2 + zigzag.T @ zigzag / ZIGZAG**2, slips))

    @functools.cached_property
    def _centre(self) -> complex:
        return complex(*np.nanmean(self.measured.reshape(-1, 2), axis=0))

    def at(self, coordinates: FloatArray, shared: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the markers (n, markers, 2), and their derivatives (n, markers, 2, k) by coordinates and shared."""
        n, joints, count, on = len(coordinates), self.on.joints, len(self.on.names), self.on
        scale, gradient, oblique = float(np.exp(shared[0])), complex(*shared[1:3]), complex(*shared[3:5])
        planes = shared[_CAMERA : _CAMERA + on.shift.size * 3].reshape(-1, 3)
        lever = np.where(np.arange(joints + 1) < on.link[:, None], on.lengths, 0.0j)
        lever[np.arange(count), on.link] = on.station + self.places(shared) @ [1.0, 1.0j]
        psi = coordinates[:, 2:3] + np.pi + np.cumsum(np.pad(coordinates[:, 3 : 3 + joints], ((0, 0), (1, 0))), axis=1)
        direction = np.exp(1j * psi)
        arm = lever[None] * direction[:, None]  # (n, markers, links)
        across = 1j * direction[:, 0]
        slip = coordinates[:, 3 + joints :] @ on.inside.T
        body = coordinates[:, :1] + 1j * coordinates[:, 1:2] + arm.sum(axis=2) + slip * across[:, None]
        far = body - self._centre
        zoom = 1.0 + on.inside @ planes[:, 2]
        flat = zoom * far + on.inside @ (planes[:, 0] + 1j * planes[:, 1])

        own = np.zeros((n, count, self.coordinates), dtype=np.complex128)
        own[..., 0], own[..., 1] = 1.0, 1.0j
        turned = 1j * np.cumsum(arm[..., ::-1], axis=2)[..., ::-1]  # by a turn of this link and all behind it
        own[..., 2 : 3 + joints] = turned
        own[..., 2] -= slip * direction[:, :1]
        own[..., 3 + joints :] = across[:, None, None] * on.inside
        by = np.zeros((n, count, len(shared)), dtype=np.complex128)
        first, markers = _CAMERA + planes.size, np.arange(count)
        by[..., _CAMERA:first:3] = on.inside
        by[..., _CAMERA + 1 : first : 3] = 1j * on.inside
        by[..., _CAMERA + 2 : first : 3] = far[..., None] * on.inside
        by[:, markers, first + 2 * markers] = zoom * direction[:, on.link]
        by[:, markers, first + 2 * markers + 1] = 1j * zoom * direction[:, on.link]
        return self._seen(flat, own * zoom[:, None], by, scale, gradient, oblique)

    def _seen(
        self, flat: ComplexArray, own: ComplexArray, by: ComplexArray, scale: float, gradient: complex, oblique: complex
    ) -> tuple[FloatArray, FloatArray]:
        """Put points through the camera, u = c + scale p / (1 + gamma . p) with p from the centre."""
        depth = 1.0 + (gradient.conjugate() * flat).real
        squeezed = flat + oblique * flat.conjugate()
        seen = scale * squeezed / depth

        def through(slope: ComplexArray) -> ComplexArray:
            tilt = (gradient.conjugate() * slope).real
            slope = slope + oblique * slope.conjugate()
            return np.asarray((scale * slope - seen[..., None] * tilt) / depth[..., None])

        shared = through(by)
        shared[..., 0] = seen
        shared[..., 1] = -seen * flat.real / depth
        shared[..., 2] = -seen * flat.imag / depth
        shared[..., 3] = scale * flat.conjugate() / depth
        shared[..., 4] = 1j * shared[..., 3]
        return _pair(seen + self._centre), _pair(np.concatenate([through(own), shared], axis=2))


def _pair(values: ComplexArray) -> FloatArray:
    """Return real and imaginary parts as axis 2."""
    return np.stack([values.real, values.imag], axis=2)
