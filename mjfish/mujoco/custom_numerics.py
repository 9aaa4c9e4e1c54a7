"""The water in an MJCF, as custom numerics: MuJoCo keeps them and does nothing with them.

``strip_fluid/density`` [kg/m3]; ``strip_fluid/BODY/KEY``, KEY any number or list of numbers that a `StripLink` or a
`BluntLink` takes (``length``, ``station``, ``height``, ``c_d``, ``semiaxes``, ...); ``strip_fluid/BODY/sections``, or
``strip_fluid/sections`` for all links that give no height and width: rows of ROW numbers, one a piece of the outline.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import mujoco
import numpy as np

from mjfish.errors import InputError, UnknownNameError
from mjfish.files import tomlfile
from mjfish.fish import Section
from mjfish.mujoco.links import COEFFICIENTS, KEYS, StripLink, Water

#: What every name begins with.
PREFIX = "strip_fluid"
#: Custom text with the table ``identified`` of the fish, as JSON; nothing reads it here.
IDENTIFIED = f"{PREFIX}/identified"
#: Numbers of a row of sections: from, to, height there and there, width there and there [m], profile.
ROW = 7
#: Profiles by their number in a row.
PROFILES = ("linear", "elliptic")
_OUTLINE = ("station", "height", "width", "sections", *KEYS)


def read(model: mujoco.MjModel) -> Water:
    """Read the water from the custom numerics of a model.

    Raises:
        InputError, UnknownNameError: there are none, or a key is broken.
    """
    links: dict[str, dict[str, object]] = {}
    water: dict[str, object] = {}
    for index in range(model.nnumeric):
        numeric = model.numeric(index)
        prefix, _, name = numeric.name.partition("/")
        if prefix != PREFIX:
            continue
        body, _, key = name.rpartition("/")
        numbers = numeric.data.tolist()
        value = _rows(numeric.name, numbers) if key == "sections" else numbers[0] if len(numbers) == 1 else numbers
        (links.setdefault(body, {"body": body}) if body else water)[key] = value
    shared = {"sections": water.pop("sections")} if "sections" in water else {}
    for key in water.keys() - {"density"}:
        known = [f"{PREFIX}/density", f"{PREFIX}/sections", f"{PREFIX}/BODY/KEY"]
        raise UnknownNameError("custom numeric", f"{PREFIX}/{key}", known)
    if not links:
        raise InputError(
            f"the model has no custom numeric '{PREFIX}/BODY/KEY'; describe its bodies there, or give the links"
        )
    for link in links.values():
        link |= {} if link.keys() & set(_OUTLINE) else shared
    return tomlfile.parse({**water, "links": list(links.values())}, Water, f"custom numeric {PREFIX}")


def _rows(name: str, numbers: Sequence[float]) -> list[dict[str, object]]:
    """Return rows of numbers as sections, as a TOML would give them."""
    if len(numbers) % ROW:
        raise InputError(
            f"custom numeric {name}: {len(numbers)} numbers, expected rows of {ROW}: from, to, height there and there, "
            "width there and there, profile; complete the last row"
        )
    rows = []
    for row, (start, end, h0, h1, w0, w1, profile) in enumerate(np.reshape(numbers, (-1, ROW)).tolist(), start=1):
        if profile not in range(len(PROFILES)):
            known = ", ".join(f"{number} ({kind})" for number, kind in enumerate(PROFILES))
            raise InputError(f"custom numeric {name}: profile {profile:g} in row {row}, expected {known}; correct it")
        kind = PROFILES[int(profile)]
        rows.append({"from": start, "to": end, "profile": kind, "height": (h0, h1), "width": (w0, w1)})
    return rows


def numerics_of(links: Sequence[StripLink], density: float) -> dict[str, tuple[float, ...]]:
    """Return the numerics by name that `read` turns into these links; sections that all links share come once.

    Coefficients are always there, other keys where they are not their defaults.

    Raises:
        InputError: two links share a body, which the names could not tell apart.
    """
    body, count = Counter(link.body for link in links).most_common(1)[0]
    if count > 1:
        raise InputError(f"two links share the body '{body}', an MJCF describes one a body; use a TOML")
    numerics: dict[str, tuple[float, ...]] = {f"{PREFIX}/density": (density,)}
    shared = links[0].sections if len({link.sections for link in links}) == 1 else ()
    if shared:
        numerics[f"{PREFIX}/sections"] = _flat(shared)
    for link in links:
        for key, field in StripLink.model_fields.items():
            value = getattr(link, key)
            if key == "body" or (value == field.default and key not in COEFFICIENTS) or (key == "sections" and shared):
                continue
            numbers = _flat(value) if key == "sections" else value if isinstance(value, tuple) else (value,)
            numerics[f"{PREFIX}/{link.body}/{key}"] = tuple(map(float, numbers))
    return numerics


def _flat(sections: Sequence[Section]) -> tuple[float, ...]:
    rows = ((s.start, s.end, *s.height, *s.width, float(PROFILES.index(s.profile))) for s in sections)
    return tuple(number for row in rows for number in row)
