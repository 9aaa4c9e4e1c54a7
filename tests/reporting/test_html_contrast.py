"""Colours of the page: text has a contrast of 4.5 : 1 at least, lines and bars of 3 : 1, light and dark."""

from __future__ import annotations

import re
from itertools import product

import pytest
from diagnosed import page

#: Grounds that text and figures stand on.
GROUNDS = ("paper", "card")
#: Lines, bars and markers.
MARKS = ("measured", "nominal", "extended")
#: Text on a ground of its own, by colour and ground: badges, code, mixtures. Cells of the isolability are mixed by the
#: share that a column imitates, times the heat of the theme; a share below a tenth is written muted.
SPECIAL = (
    ("card", "extended"), ("card", "good"), ("card", "caution"), ("card", "bad"), ("ink", "track"), ("muted", "track"),
    ("muted", ("extended", 0.06, "paper")), ("ink", ("nominal", 1.0, "track")), ("muted", ("nominal", 0.1, "track")),
)  # fmt: skip


def _style() -> str:
    html = page()
    return html[html.index("<style>") : html.index("</style>")]


def _palettes() -> dict[str, dict[str, str]]:
    style = _style()
    start, dark = style.index(":root, :root.paper {"), style.index("@media (prefers-color-scheme: dark)")
    light = dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6});", style[start:dark]))
    own = dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6});", style[dark : style.index("* { box-sizing")]))
    assert set(light) == set(own), "a colour of one theme only"
    return {"light": light, "dark": own}


def _channels(colour: str) -> list[float]:
    return [int(colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5)]


def _mixed(first: list[float], share: float, second: list[float]) -> list[float]:
    return [share * a + (1.0 - share) * b for a, b in zip(first, second, strict=True)]


def _luminance(channels: list[float]) -> float:
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def _contrast(first: list[float], second: list[float]) -> float:
    """Return the contrast of WCAG 2.2."""
    dark, light = sorted((_luminance(first), _luminance(second)))
    return (light + 0.05) / (dark + 0.05)


def test_the_contrast_is_that_of_the_standard() -> None:
    assert _contrast([0.0] * 3, [1.0] * 3) == pytest.approx(21.0)
    assert _contrast(_channels("#767676"), [1.0] * 3) == pytest.approx(4.54, abs=0.01)


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_text_is_legible_on_every_ground(theme: str) -> None:
    palette = {name: _channels(colour) for name, colour in _palettes()[theme].items()}
    used = set(re.findall(r"(?<![\w-])color: var\(--([\w-]+)\)", _style()))
    assert {"ink", "muted", "link"} <= used
    heat = dict(zip(("light", "dark"), map(float, re.findall(r"--heat: ([0-9.]+);", _style())), strict=True))
    texts = used - {"card", "nominal", "accent"}  # text on badges, see below; whiskers are marks
    for text, ground in product(sorted(texts), GROUNDS):
        assert _contrast(palette[text], palette[ground]) >= 4.5, f"{text} on {ground}"
    for text, ground in SPECIAL:
        if isinstance(ground, tuple):
            over, share, under = ground
            share *= heat[theme] if under == "track" else 1.0
            behind = _mixed(palette[over], share, palette[under])
        else:
            behind = palette[ground]
        assert _contrast(palette[text], behind) >= 4.5, f"{text} on {ground}"


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_lines_and_bars_stand_out_from_the_ground(theme: str) -> None:
    palette = {name: _channels(colour) for name, colour in _palettes()[theme].items()}
    for mark, ground in product(MARKS, GROUNDS):
        assert _contrast(palette[mark], palette[ground]) >= 3.0, f"{mark} on {ground}"
