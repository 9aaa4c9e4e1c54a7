"""How much the free fish rolls, mode by mode: writes docs/roll.md, every number of it.

python -m studies.roll [--out docs/roll.md]
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Iterable, Sequence
from pathlib import Path

import jinja2
import numpy as np

from mjfish.drive import modes
from mjfish.files.writing import write_text
from mjfish.mujoco import Trim
from studies.markdown import table, wrapped
from studies.roll.runs import (
    BIASES,
    END,
    MARKER,
    OMEGAS,
    ONSET,
    PIKE,
    START,
    STEEP,
    STRAIGHT,
    TURNS,
    WATERS,
    WHOLE,
    Pair,
    fast_start,
    mode,
    turn,
)
from studies.table_iv.ranges import PAPER

#: [m/s2].
_GRAVITY = 9.81
TRIMS = tuple(
    Trim(arm=arm, drop=drop)
    for arm, drop in ((0.002, 0.002), (0.004, 0.004), (0.008, 0.008), (0.004, 0.002), (0.004, 0.008))
)


def straight() -> str:
    """Return the table of straight swimming."""
    head = ["omega [rad/s]"]
    for water in WATERS:
        head += [f"{water}: peak at the start [deg]", "steady amplitude [deg]", "pitch [deg]", "depth [m]"]
    rows = []
    for omega in OMEGAS:
        row = [f"{omega:g}"]
        for water in WATERS:
            pair = turn(omega, "straight", water)
            row += [f"{pair.peak(START):.1f}", _unless_steep(pair, STRAIGHT, f"{pair.swing(STRAIGHT)[1]:.1f}")]
            row += [f"{pair.peak(WHOLE, 'pitch'):.0f}", f"{-pair.free.attitude[:, 2].min():.1f}"]
        rows.append(row)
    return table(head, rows)


def turns() -> str:
    """Return the table of turns."""
    head = ["omega [rad/s]", "bias"]
    for water in WATERS:
        head += [f"{water}: peak at the onset [deg]", "steady [deg]", "V Omega / g [deg]"]
    rows = []
    for omega, bias in itertools.product(OMEGAS, TURNS):
        row = [f"{omega:g}", bias]
        for water in WATERS:
            pair = turn(omega, bias, water)
            middle, amplitude = pair.swing(END)
            row += [f"{pair.peak(ONSET):.1f}", _unless_steep(pair, END, f"{middle:.1f} ± {amplitude:.1f}")]
            row.append(f"{np.degrees(-pair.mean(END, 0) * pair.mean(END, 2) / _GRAVITY):.1f}")
        rows.append(row)
    return table(head, rows)


def _unless_steep(pair: Pair, stretch: tuple[float, float], text: str) -> str:
    return "stands" if pair.steep(stretch) else text


def fast() -> str:
    """Return the table of the fast start."""
    head = [
        "coefficients",
        "peak roll [deg]",
        "peak pitch [deg]",
        "top speed, planar [m/s]",
        "surge / sway / yaw rate [%]",
    ]
    rows = []
    for water in WATERS:
        pair = mode("fast", water)
        row = [water, f"{pair.peak(WHOLE):.1f}", f"{pair.peak(WHOLE, 'pitch'):.1f}"]
        rows.append([*row, f"{pair.plane.velocity[:, 0].max():.2f}", _three(pair.change())])
    return table(head, rows)


def missed() -> str:
    """Return the table of what the planar model misses."""
    head = ["mode", *(f"{water}: {what}" for water in WATERS for what in ("start-up", "whole run", "marker")), "paper"]
    rows = []
    for name in modes.MODES:
        row = [name]
        for water in WATERS:
            pair = mode(name, water)
            whole = _unless_steep(pair, WHOLE, _three(pair.change()))
            row += [_three(pair.change(START)), whole, f"{pair.marker(START):.1f}"]
        rows.append([*row, _three(100.0 * rmse for rmse in PAPER[name][1])])
    return table(head, rows)


def _three(numbers: Iterable[float]) -> str:
    return " / ".join(f"{number:.1f}" for number in numbers)


def trims() -> str:
    """Return the table of the trim."""
    names = ("v1", "v7", "fast")
    head = [
        "righting arm [mm]",
        "mass below the axis [mm]",
        *(f"{water}: {name}" for water in WATERS for name in names),
    ]
    rows = [
        [f"{1e3 * trim.arm:g}", f"{1e3 * trim.depth:g}"]
        + [f"{mode(name, water, trim).peak(START):.1f}" for water in WATERS for name in names]
        for trim in TRIMS
    ]
    return table(head, rows)


def findings(water: str) -> dict[str, str]:
    """Return what the runs of a water say of the paper's remark."""
    ahead = [turn(omega, "straight", water) for omega in OMEGAS]
    turned = [tuple(turn(omega, bias, water) for bias in TURNS) for omega in OMEGAS]
    lying = [(a, b) for a, b in turned if not (a.steep(END) or b.steep(END))]
    change = np.array([pair.change(START) for pair in ahead])
    return {
        "steady": _grows([pair.swing(STRAIGHT)[1] for pair in ahead if not pair.steep(STRAIGHT)]),
        "start": _grows([pair.peak(START) for pair in ahead]),
        "onset": f"{sum(b.peak(ONSET) > a.peak(ONSET) for a, b in turned)} of {len(turned)}",
        "heel": f"{sum(b.swing(END)[0] > a.swing(END)[0] for a, b in lying)} of {len(lying)}",
        "surge": _span(change[:, 0]),
        "sway": _span(change[:, 1]),
        "yaw": _span(change[:, 2]),
        "any": _span(change.ravel()),
        "level": _span([pair.change(START, level=True)[0] for pair in ahead]),
        "marker": _span([pair.marker(START) for pair in ahead]),
    }


def _grows(values: Sequence[float]) -> str:
    """Say whether a row of numbers grows."""
    up = all(b > a for a, b in itertools.pairwise(values))
    span = f"from {values[0]:.1f} deg at {OMEGAS[0]:g} to {values[-1]:.1f} at {OMEGAS[len(values) - 1]:g} rad/s"
    return f"grows, {span}," if up else f"stays about the same, {span}," if _even(values) else f"does not, {span},"


def _even(values: Sequence[float]) -> bool:
    return max(values) < 1.1 * min(values)


def _span(values: Iterable[float]) -> str:
    low, high = f"{min(values):.1f}", f"{max(values):.1f}"
    return low if low == high else f"{low} to {high}"


def page() -> str:
    """Return the page."""
    numbers = {
        "fish": PIKE.name,
        "duration": f"{modes.DURATION:g}",
        "steep": f"{np.degrees(STEEP):.0f}",
        "start": f"{START[1]:g}",
        "straight_from": f"{STRAIGHT[0]:g}",
        "straight_to": f"{STRAIGHT[1]:g}",
        "change": f"{modes.CHANGE:g}",
        "onset": f"{ONSET[1] - ONSET[0]:g}",
        "end": f"{END[1] - END[0]:g}",
        "marker_height": f"{1e3 * MARKER:.0f}",
        "fast_duration": f"{fast_start().time[-1]:g}",
        "biases": ", ".join(f"`{name}` = ({', '.join(f'{b:g}' for b in BIASES[name])})" for name in TURNS),
    }
    tables = {made.__name__: made() for made in (straight, turns, fast, missed, trims)}
    told = {
        f"{key}_{suffix}": text
        for water, suffix in zip(WATERS, ("published", "other"), strict=True)
        for key, text in findings(water).items()
    }
    template = Path(__file__).with_name("page.md.j2").read_text(encoding="utf-8")
    made = jinja2.Template(template, undefined=jinja2.StrictUndefined)
    return wrapped(made.render(**numbers, **tables, **told))


def main() -> None:
    """Write the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("docs/roll.md"), help="file to write")
    write_text(parser.parse_args().out, page())


if __name__ == "__main__":
    main()
