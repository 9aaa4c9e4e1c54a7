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

from mjfish.numerics.arrays import BoolArray, FloatArray
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


@dataclass(frozen=True)
class Marker:
    """A marker on a link.

    Attributes:
        link: which, 0 is the head.
        station: behind the front joint of its link, along the straight fish [m].
        along: how far it may sit from there along the link [m], one standard deviation; 0: exactly there.
        across: the same to the side [m].
    """

    link: int
    station: float
    along: float = 0.0
    across: float = 0.0


@dataclass(frozen=True)
class Plane:
    """Markers at another height than the first ones.

    Attributes:
        markers: by number.
        shift: how far they may appear shifted [m], one standard deviation.
        slip: how far they wobble sideways with the beat [m], one standard deviation.
    """

    markers: tuple[int, ...]
    shift: float
    slip: float


@dataclass(frozen=True, eq=False)
class Chain:
    """Markers seen on a chain; coordinates are x, y [m], yaw [rad] of the nose, joint angles [rad], slips [m].

    Attributes:
        measured: (n, markers, 2) [m], roughly scaled; NaN where not seen.
        lengths: of the links [m].
        markers: on them.
        planes: of markers at other heights.
    """

    measured: FloatArray
    lengths: FloatArray
    markers: tuple[Marker, ...]
    planes: tuple[Plane, ...]

    @property
    def joints(self) -> int:
        """Number of joints."""
        return len(self.lengths) - 1

    @property
    def coordinates(self) -> int:
        """Number of coordinates a frame."""
        return 3 + self.joints + len(self.planes)

    @property
    def kinds(self) -> IntArray:
        """X and y, yaw, joint angles, slips (coordinates,): those of one number are equally smooth."""
        return np.array([0, 0, 1] + [2] * self.joints + [3] * len(self.planes))

    @functools.cached_property
    def belief(self) -> FloatArray:
        """Deviations from zero believed (shared,): scale, gradient (2), oblique (2), each plane (3), each marker (2)."""
        planes = [[plane.shift, plane.shift, PLANE] for plane in self.planes]
        markers = [[max(marker.along, 1e-9), max(marker.across, 1e-9)] for marker in self.markers]
        return np.concatenate([[SCALE, GRADIENT, GRADIENT, OBLIQUE, OBLIQUE], *planes, *markers])

    def places(self, shared: FloatArray) -> FloatArray:
        """Return how far the markers sit from their stations, along and across (markers, 2) [m]."""
        return shared[_CAMERA + 3 * len(self.planes) :].reshape(-1, 2)

    @property
    def doubts(self) -> FloatArray:
        """How far they are believed to (markers, 2) [m]."""
        return self.places(self.belief)

    @functools.cached_property
    def form(self) -> FloatArray:
        """Precision, once for every look, of joint angles, of their differences from joint to joint, and of slips."""
        joints = np.eye(self.joints)
        zigzag = np.diff(joints, axis=0)
        form = np.zeros((self.coordinates, self.coordinates))
        form[3 : 3 + self.joints, 3 : 3 + self.joints] = joints / ANGLE**2 + zigzag.T @ zigzag / ZIGZAG**2
        slips = np.arange(3 + self.joints, self.coordinates)
        form[slips, slips] = [1.0 / max(plane.slip, 1e-6) ** 2 for plane in self.planes]
        return form

    @functools.cached_property
    def _centre(self) -> complex:
        return complex(*np.nanmean(self.measured.reshape(-1, 2), axis=0))

    @functools.cached_property
    def _in(self) -> BoolArray:
        """Which planes (markers, planes) the markers lie in."""
        return np.array(
            [[m in plane.markers for plane in self.planes] for m in range(len(self.markers))], dtype=np.bool_
        ).reshape(len(self.markers), len(self.planes))

    def _lever(self, place: FloatArray) -> ComplexArray:
        """Return levers (markers, links) of the directions, with places (markers, 2) along and across [m]."""
        lever = np.zeros((len(self.markers), len(self.lengths)), dtype=np.complex128)
        for row, marker in enumerate(self.markers):
            lever[row, : marker.link] = self.lengths[: marker.link]
            lever[row, marker.link] = marker.station + complex(*place[row])
        return lever

    def at(self, coordinates: FloatArray, shared: FloatArray) -> Linearised:
        """Return the markers (n, markers, 2) and their derivatives."""
        n, joints, count = len(coordinates), self.joints, len(self.markers)
        scale, gradient = float(np.exp(shared[0])), complex(*shared[1:3])
        oblique = complex(*shared[3:5])
        planes, place = np.split(shared[_CAMERA:], [3 * len(self.planes)])
        planes = planes.reshape(-1, 3)
        lever = self._lever(place.reshape(-1, 2))
        psi = coordinates[:, 2:3] + np.pi + np.cumsum(np.pad(coordinates[:, 3 : 3 + joints], ((0, 0), (1, 0))), axis=1)
        direction = np.exp(1j * psi)
        arm = lever[None] * direction[:, None]  # (n, markers, links)
        across = 1j * direction[:, 0]
        slip = coordinates[:, 3 + joints :] @ self._in.T.astype(float)
        body = coordinates[:, :1] + 1j * coordinates[:, 1:2] + arm.sum(axis=2) + slip * across[:, None]
        far = body - self._centre
        zoom = 1.0 + self._in @ planes[:, 2]
        flat = zoom * far + self._in @ (planes[:, 0] + 1j * planes[:, 1])

        own = np.zeros((n, count, self.coordinates), dtype=np.complex128)
        own[..., 0], own[..., 1] = 1.0, 1.0j
        turned = 1j * np.cumsum(arm[..., ::-1], axis=2)[..., ::-1]  # by a turn of this link and all behind it
        own[..., 2 : 3 + joints] = turned
        own[..., 2] -= slip * direction[:, :1]
        own[..., 3 + joints :] = across[:, None, None] * self._in
        by = np.zeros((n, count, len(shared)), dtype=np.complex128)
        first = _CAMERA + 3 * len(self.planes)
        by[..., _CAMERA:first:3] = self._in
        by[..., _CAMERA + 1 : first : 3] = 1j * self._in
        by[..., _CAMERA + 2 : first : 3] = far[..., None] * self._in
        for m, marker in enumerate(self.markers):
            by[:, m, first + 2 * m] = zoom[m] * direction[:, marker.link]
            by[:, m, first + 2 * m + 1] = 1j * zoom[m] * direction[:, marker.link]
        return self._seen(flat, own * zoom[:, None], by, scale, gradient, oblique)

    def _seen(
        self, flat: ComplexArray, own: ComplexArray, by: ComplexArray, scale: float, gradient: complex, oblique: complex
    ) -> Linearised:
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
        return Linearised(_pair(seen + self._centre), _pair(through(own)), _pair(shared))


def _pair(values: ComplexArray) -> FloatArray:
    """Return real and imaginary parts as axis 2."""
    return np.stack([values.real, values.imag], axis=2)
