"""The water of mjfish beside published numbers.

python -m studies.validation --page docs/validation.md
"""

from __future__ import annotations

import argparse
import functools
from pathlib import Path

import jinja2
import numpy as np

from mjfish.errors import MjfishError
from mjfish.files.writing import check_file, write_text
from studies import console
from studies.markdown import table, wrapped
from studies.validation import falling_plate, oscillation, spheroid
from studies.validation.falling_plate import Fall, Terms

#: I* of a plate that flutters and of one that tumbles [Andersen2005b].
FALLING = (1.1, 1.4)


@functools.cache
def _spheroid(ratio: float) -> tuple[spheroid.Coefficients, spheroid.Coefficients]:
    return spheroid.lamb(ratio), spheroid.strips(ratio)


def c_m(ratio: float) -> tuple[float, float]:
    """Return the c_m with which strips have a spheroid's added mass in sway and its added inertia in yaw."""
    lamb, strips = _spheroid(ratio)
    return lamb.lateral / strips.lateral, lamb.rotation / strips.rotation


def spheroids() -> str:
    """Return the table of spheroids."""
    head = ["length / width", "Lamb k1", "k2", "k'", "strips k1", "k2", "k'", "c_m, sway", "c_m, yaw"]
    rows = []
    for ratio, *published in spheroid.PUBLISHED:
        strips = _spheroid(ratio)[1]
        row = [*published, strips.axial, strips.lateral, strips.rotation, *c_m(ratio)]
        rows.append([f"{ratio:.2f}", *(f"{value:z.3f}" for value in row[:-2]), *(f"{value:.2f}" for value in row[-2:])])
    return table(head, rows)


@functools.cache
def _swung(kc: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return C_D and C_M of the plate whose KC is given, and of the one that estimates it."""
    c_d, power = oscillation.drag_law()
    given = oscillation.swing(kc, {"c_d": c_d, "kc": kc, "kc_power": power})
    return given, oscillation.swing(kc, {"c_d": c_d}, "keulegan_carpenter_drag", (power,))


def drag() -> str:
    """Return the table of drag."""
    head = ["KC", "measured C_D", "8 KC^(-1/3)", "`kc=`: C_D", "C_M", "estimating cause: C_D", "C_M"]
    rows = []
    for kc, measured in oscillation.PLATES:
        (a, b), (c, d) = _swung(kc)
        rows.append([f"{kc:g}", *(f"{value:.2f}" for value in (measured, oscillation.graham(kc), a, b, c, d))])
    return table(head, rows)


@functools.cache
def _inertia(kc: float) -> float:
    return oscillation.swing(kc, {"c_m": 1.0}, "added_mass_amplitude", oscillation.inertia_law())[1]


def inertia() -> str:
    """Return the table of inertia."""
    head = ["KC", "published C_M", "mjfish C_M"]
    numbers = ((kc, oscillation.luhar_inertia(kc), _inertia(kc)) for kc in oscillation.INERTIA_KC)
    return table(head, ([f"{kc:g}", f"{a:.2f}", f"{b:.2f}"] for kc, a, b in numbers))


@functools.cache
def _falls(i_star: float) -> dict[str, Fall]:
    return {
        "published equations": falling_plate.published(i_star),
        "C_R = 0": falling_plate.published(i_star, Terms(rotation=0.0)),
        "C_R = 0, C_T = B, mu_1 = 0": falling_plate.published(i_star, falling_plate.AS_STRIPS),
        "strips, `munk_moment` 0": falling_plate.strips(i_star, 0.0),
        "strips, `munk_moment` 1": falling_plate.strips(i_star, 1.0),
    }


def falls() -> str:
    """Return the table of falling plates."""
    head = ["model", "I*", "it", "turns", "swing [deg]", "descent [U]", "drift [U]"]
    rows = []
    for i_star in FALLING:
        for model, fall in _falls(i_star).items():
            swing = "-" if fall.motion == "tumbles" else f"{fall.swing:.0f}"
            row = [model, f"{i_star:g}", fall.motion, f"{abs(fall.turns):.1f}", swing]
            rows.append([*row, f"{fall.descent:.2f}", f"{fall.drift:.2f}"])
    return table(head, rows)


def _facts() -> dict[str, str]:
    """Return the numbers in the sentences of the page."""
    errors = [
        np.abs(np.subtract((lamb.axial, lamb.lateral, lamb.rotation), published)).max()
        for (ratio, *published) in spheroid.PUBLISHED
        for lamb in [spheroid.lamb(ratio)]
    ]
    gaps = [100.0 * (1.0 - c_m(ratio)[1] / c_m(ratio)[0]) for ratio in (4.0, 10.0)]
    c_d, power = oscillation.drag_law()
    estimated = [(kc, *_swung(kc)[1], _swung(kc)[0][0]) for kc, _ in oscillation.PLATES]
    near = estimated[2]
    rise = [abs(_inertia(kc) / oscillation.luhar_inertia(kc) - 1.0) for kc in oscillation.INERTIA_KC if kc <= 4.0]
    loss, half = oscillation.inertia_law()
    rocking = [_falls(i_star)["strips, `munk_moment` 1"] for i_star in FALLING]
    fast = [
        fall.descent / _falls(i_star)["published equations"].descent
        for i_star, fall in zip(FALLING, rocking, strict=True)
    ]
    fluttering = _falls(FALLING[0])["published equations"]
    reduced = [_falls(i_star)["C_R = 0, C_T = B, mu_1 = 0"].descent for i_star in FALLING]
    alike = [abs(fall.descent / descent - 1.0) for fall, descent in zip(rocking, reduced, strict=True)]
    return {
        "lamb_error": f"{max(errors):.3f}",
        "gap_four": f"{gaps[0]:.0f}",
        "gap_ten": f"{gaps[1]:.0f}",
        "axial_four": f"{100.0 * spheroid.lamb(4.0).axial:.0f}",
        "c_d": f"{c_d:.1f}",
        "power": f"{power:.2f}",
        "law_misfit": f"{100.0 * oscillation.misfit(c_d, power):.0f}",
        "graham_misfit": f"{100.0 * oscillation.misfit(oscillation.graham(oscillation.KC_0), 1.0 / 3.0):.0f}",
        "estimate_drag": f"{100.0 * max(found / law - 1.0 for _, found, _, law in estimated):.0f}",
        "estimate_low": f"{estimated[-1][2]:.2f}",
        "estimate_inertia": f"{near[2]:.2f}",
        "estimate_kc": f"{near[0]:g}",
        "rising_low": f"{oscillation.RISING[0]:g}",
        "rising_high": f"{oscillation.RISING[1]:g}",
        "loss": f"{loss:.2f}",
        "half": f"{half:.2f}",
        "rise_misfit": f"{100.0 * max(rise):.0f}",
        "duration": f"{falling_plate.DURATION:g}",
        "angle": f"{np.degrees(falling_plate.START[1]):.0f}",
        "swing": f"{fluttering.swing:.0f}",
        "rock_low": f"{min(fall.swing for fall in rocking):.0f}",
        "rock_high": f"{max(fall.swing for fall in rocking):.0f}",
        "fast_low": f"{min(fast):.1f}",
        "fast_high": f"{max(fast):.1f}",
        "as_strips": f"{100.0 * max(alike):.0f}",
    }


def page() -> str:
    """Return the page."""
    tables = {made.__name__: made() for made in (spheroids, drag, inertia, falls)}
    template = Path(__file__).with_name("page.md.j2").read_text(encoding="utf-8")
    return wrapped(jinja2.Template(template, undefined=jinja2.StrictUndefined).render(**tables, **_facts()))


def main() -> int:
    """Compute, and print the page or write it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--page", type=Path, help="file to write; without it the page is printed")
    target = parser.parse_args().page
    try:
        if target is None:
            console.out.print(page(), soft_wrap=True)
        else:
            check_file(target)
            write_text(target, page())
    except MjfishError as error:
        console.err.print(str(error), soft_wrap=True)
        return console.MISUSE
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
