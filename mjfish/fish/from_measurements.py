"""A first fish from a few measurements, to be corrected link by link.

Outline, joints, coefficients and oscillators are in proportion to those of the robotic pike of [Yu2016], whose shape is
that of many swimming robots: a stiff front half, a body that tapers, a caudal fin. Masses follow the volume.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from mjfish.errors import InputError
from mjfish.files import tomlfile
from mjfish.fish import ByGroup, Coefficient, Coefficients, Cpg, Fish, Link, Section, Servo
from mjfish.fish.outline import LinkOutline, outline

#: Pieces of the outline: end as a share of the length; height there as a share of the largest, width as one of the
#: largest width.
_OUTLINE = ((0.28, 1.0, 1.0), (0.47, 1.0, 1.0), (0.78, 0.62, 0.45), (0.88, 0.31, 0.15))
#: The fin: its height at the tip as a share of the largest, its thickness as one of the largest width.
_FIN, _THICKNESS = 1.15, 0.05
#: The first and the last joint, as shares of the length.
_FIRST, _LAST = 0.47, 0.78
#: Width over height of the largest section.
_WIDTH = 0.8
#: Amplitudes of the pike's four joints and of a single one [rad]; the phase from its first to its last joint [rad],
#: and the largest from joint to joint: two joints that are half a beat apart do not make a wave.
_SWING, _SINGLE, _PHASE, _APART = (0.31, 0.46, 0.53, 0.67), 0.5, 3.67, 1.3
#: Size of one unit of the oscillators' psi [rad].
_UNIT = 0.1
#: Coefficients by kind: plain-plate numbers of textbooks, how far they are trusted; no fit.
_COEFFICIENTS = {
    "c_m": Coefficient(value=0.8, sd=0.4, start=0.8, low=0.01, high=3.0),
    "c_d": Coefficient(value=1.5, sd=1.0, start=1.5, low=0.05, high=20.0),
    "c_f": Coefficient(value=0.01, sd=0.02, start=0.01, low=1e-5, high=1.0),
}
#: Damping of a servo over the least inertia of a link about its joint [1/s]: explicit integration is stable up to a
#: step of 2 ms. Stiffness over damping [1/s].
_DAMPED, _STIFF = 200.0, 400.0


def new_fish(
    name: str,
    *,
    length: float,
    mass: float,
    joints: int,
    height: float,
    width: float | None = None,
    density: float = 1000.0,
) -> Fish:
    """Return a fish of a typical shape with these measurements; everything else of it is a guess.

    Args:
        name: of the fish.
        length: from nose to tip of the fin [m].
        mass: of the whole fish [kg].
        joints: 1 to 20; the first is at 0.47 of the length, the last at 0.78, and a single one there.
        height: of the highest section of the body [m].
        width: of the widest section [m]; None: 0.8 of the height.
        density: of the water [kg/m3].

    Raises:
        InputError: a measurement that no fish has.

    Example:
        >>> import mjfish
        >>> fish = mjfish.new_fish("trout", length=0.4, mass=0.6, joints=1, height=0.07)
        >>> [link.name for link in fish.links]
        ['head', 'tail']
        >>> round(sum(link.mass for link in fish.links), 6)
        0.6
    """
    width = _WIDTH * height if width is None else width
    _check(length, mass, joints, height, width)
    with tomlfile.complaining(f"fish '{name}'"):
        sections = _sections(length, height, width)
        ends = [
            0.0,
            *(round(float(s), 6) for s in length * np.linspace(_FIRST if joints > 1 else _LAST, _LAST, joints)),
            length,
        ]
        links = _links(["head", *(f"body_{k}" for k in range(1, joints)), "tail"], ends, sections, mass)
        groups = tuple(dict.fromkeys(link.group for link in links))
        damping = _DAMPED * min(link.inertia + link.mass * link.com**2 for link in links[1:])
        return Fish.model_validate({
            "schema": 1,
            "name": name,
            "about": "shape and coefficients in proportion to a robotic pike; length, mass, joints and height measured",
            "density": density,
            "links": links,
            "sections": sections,
            "coefficients": Coefficients(
                **{kind: ByGroup(dict.fromkeys(groups, own)) for kind, own in _COEFFICIENTS.items()}
            ),
            "cpg": _oscillators(joints),
            "servo": Servo(kp=float(f"{_STIFF * damping:.3g}"), kv=float(f"{damping:.3g}")),
        })  # fmt: skip


def _check(length: float, mass: float, joints: int, height: float, width: float) -> None:
    """Refuse measurements that no fish has."""
    for what, value, unit in (
        ("length", length, "m"),
        ("mass", mass, "kg"),
        ("height", height, "m"),
        ("width", width, "m"),
    ):
        if not 0.0 < value < np.inf:
            raise InputError(f"{what}: found {value:g} {unit}, expected a number above 0; measure it anew")
    if not 1 <= joints <= 20:
        raise InputError(f"joints: found {joints}, expected 1 to 20")
    for what, value in (("height", height), ("width", width)):
        if value > length:
            raise InputError(f"{what}: found {value:g} m, more than the length of {length:g} m; give both in metres")


def _sections(length: float, height: float, width: float) -> tuple[Section, ...]:
    """Return the pieces of the outline, of which the first is a blunt nose and the last the fin."""
    shares = ((0.0, 0.0, 0.0), *_OUTLINE)
    corners = [(round(s * length, 6), round(high * height, 6), round(wide * width, 6)) for s, high, wide in shares]
    pieces = [(a[0], b[0], (a[1], b[1]), (a[2], b[2])) for a, b in itertools.pairwise(corners)]
    fin = round(_THICKNESS * width, 6)
    pieces.append((corners[-1][0], length, (corners[-1][1], round(_FIN * height, 6)), (fin, fin)))
    return tuple(
        Section.model_validate({
            "from": start, "to": end, "profile": "linear" if start else "elliptic", "height": high, "width": wide,
        })
        for start, end, high, wide in pieces
    )  # fmt: skip


def _links(names: Sequence[str], ends: Sequence[float], sections: tuple[Section, ...], mass: float) -> tuple[Link, ...]:
    """Return links of one density, with centre of mass and inertia of a body of elliptic sections."""
    pieces = [outline(sections, 1.0, start, end) for start, end in itertools.pairwise(ends)]
    per_volume = mass / sum(piece.volume for piece in pieces)
    return tuple(
        Link(
            name=name,
            group=name.partition("_")[0],
            length=round(end - start, 6),
            mass=_rounded(per_volume * piece.volume),
            com=_rounded(piece.centroid),
            inertia=_rounded(per_volume * _spread(piece)),
        )
        for name, (start, end), piece in zip(names, itertools.pairwise(ends), pieces, strict=True)
    )


def _rounded(number: float) -> float:
    """Return six digits of a number: what a reader of the file can read."""
    return float(f"{number:.6g}")


def _spread(piece: LinkOutline) -> float:
    """Return INT A ((r - c)^2 + w^2 / 16) dr of elliptic sections of area A about the centroid c [m5]."""
    area = 0.25 * np.pi * piece.strip_height * piece.strip_width
    return float(piece.strip_weight @ (area * ((piece.strip_r - piece.centroid) ** 2 + piece.strip_width**2 / 16.0)))


def _oscillators(joints: int) -> Cpg:
    """Return oscillators that bend the fish about as the pike's do: angles go with the spacing of the joints."""
    if joints == 1:
        return Cpg(amplitude=((_SINGLE / _UNIT) ** 2,), h1=4.0, h2=5.0, beta=1.0, unit=_UNIT, phase=0.0)
    places = np.linspace(0.0, len(_SWING) - 1.0, joints)
    swing = np.interp(places, np.arange(len(_SWING)), _SWING) * len(_SWING) / joints
    amplitude = tuple(float(f"{(angle / _UNIT) ** 2:.4g}") for angle in swing)
    return Cpg(amplitude=amplitude, h1=4.0, h2=5.0, beta=1.0, unit=_UNIT, phase=min(_PHASE / (joints - 1), _APART))
