"""What the water must know of a blunt body: an ellipsoid, or its added mass as a matrix."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from mjfish.fish import NotNegative
from mjfish.hydro.blunt_force import ellipsoid_added_mass, ellipsoid_turning
from mjfish.mujoco.strip_link import COEFFICIENTS, LARGEST, Described, Point, Size, point, without_arrays
from mjfish.numerics.arrays import FloatArray

_SYMMETRIC = 1e-9  # of the largest entry
#: Keys of which a table must have one to be a `BluntLink`.
KEYS = ("semiaxes", "added_mass")


def _matrix(value: object) -> object:
    """Take six numbers for a diagonal, 36 or six rows of six for a matrix."""
    value = without_arrays(value)
    if not isinstance(value, tuple):
        return value
    try:
        numbers = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        numbers = np.zeros(0)
    if numbers.size not in (6, 36) or numbers.shape not in ((6,), (36,), (6, 6)) or not np.isfinite(numbers).all():
        raise ValueError("expected six numbers, a diagonal, or a matrix of 6 x 6; correct it")
    matrix = np.diag(numbers) if numbers.size == 6 else numbers.reshape(6, 6)
    largest = np.abs(matrix).max()
    if np.abs(matrix - matrix.T).max() > _SYMMETRIC * largest:
        raise ValueError("expected a symmetric matrix; take the mean of it and its transpose")
    if np.linalg.eigvalsh(matrix).min() < -_SYMMETRIC * largest:
        raise ValueError("found a negative eigenvalue, expected none; correct its signs")
    return tuple(map(tuple, matrix.tolist()))


Row = tuple[float, float, float, float, float, float]
Matrix = Annotated[tuple[Row, Row, Row, Row, Row, Row], BeforeValidator(_matrix)]
Semiaxes = Annotated[tuple[Size, Size, Size], BeforeValidator(point)]
Amounts = Annotated[tuple[NotNegative, NotNegative, NotNegative], BeforeValidator(point)]


class BluntLink(Described):
    """A body in water that strips do not describe: a hull, a float, a sphere.

    The force is that of `mjfish.hydro.blunt_force`, in the axes of the body. Either it is an ellipsoid along these
    axes, or its added mass is given, with areas and volume; what is given replaces what the ellipsoid has.

    Attributes:
        body: name of the body in the MuJoCo model.
        semiaxes: of the ellipsoid along x, y, z of the body [m].
        added_mass: about the origin, forces first: diagonal (6,) or matrix (6, 6) [kg, kg m, kg m2], symmetric, at no
            motion negative.
        area: that the body shows to the water along x, y, z [m2]; of an ellipsoid, those of its ellipses.
        turning: T of the drag about x, y, z [m5]; without an ellipsoid, 0.
        volume: displaced [m3].
        origin: middle of the ellipsoid, and where `added_mass` and the drag hold, in the body's frame [m].
        buoyancy_center: in the body's frame [m]; absent: the origin.
        c_m: factor of the added mass.
        c_d: drag, of the areas.
        munk_moment: share of the Munk moment: 1 Kirchhoff.

    Raises:
        InputError: every broken key, by name.

    Example:
        >>> hull = mjfish.BluntLink(body="hull", semiaxes=[0.4, 0.2, 0.2], c_d=0.3)
        >>> hull.matrix(1000.0).diagonal().round(2).tolist()
        [14.08, 47.2, 47.2, 0.0, 0.64, 0.64]
    """

    semiaxes: Semiaxes | None = None
    added_mass: Matrix | None = None
    area: Amounts | None = None
    turning: Amounts | None = None
    volume: Annotated[NotNegative, Field(le=LARGEST**3)] | None = None
    origin: Point = (0.0, 0.0, 0.0)
    buoyancy_center: Point | None = None
    c_m: float = COEFFICIENTS["c_m"].default
    c_d: float = COEFFICIENTS["c_d"].default
    munk_moment: float = 1.0

    @model_validator(mode="after")
    def _described(self) -> BluntLink:
        if self.semiaxes is None:
            for key in ("added_mass", "area", "volume"):
                if getattr(self, key) is None:
                    raise ValueError(f"{key}: this key is missing, as there are no 'semiaxes'; add either")
        return self

    def matrix(self, density: float) -> FloatArray:
        """Return the added mass (6, 6) about the origin, for c_m = 1."""
        if self.added_mass is not None:
            return np.array(self.added_mass)
        assert self.semiaxes is not None  # noqa: S101 - see _described
        return np.diag(ellipsoid_added_mass(self.semiaxes, density))

    @property
    def areas(self) -> FloatArray:
        """S (3,) of the drag [m2]."""
        if self.area is not None:
            return np.array(self.area)
        a, b, c = self.semiaxes or (0.0, 0.0, 0.0)
        return np.pi * np.array([b * c, c * a, a * b])

    @property
    def turnings(self) -> FloatArray:
        """T (3,) of the drag [m5]."""
        if self.turning is not None:
            return np.array(self.turning)
        return ellipsoid_turning(self.semiaxes or (0.0, 0.0, 0.0))

    @property
    def displaced(self) -> float:
        """Volume [m3]."""
        if self.volume is not None:
            return self.volume
        return float(4.0 / 3.0 * np.pi * np.prod(self.semiaxes or (0.0, 0.0, 0.0)))
