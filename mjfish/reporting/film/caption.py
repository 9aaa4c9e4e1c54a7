"""The words over a picture: whose run it is, what each colour stands for, the time, and how it is shown."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from mjfish.numerics.formats import percent
from mjfish.reporting.film.shot import LONG
from mjfish.reporting.film.stretch import Stretch
from mjfish.reporting.log.drawing import COLOURS, FORCES

Colour = tuple[int, int, int]
Item = TypeVar("Item")
#: Height of the letters, in heights of the picture, and of the smallest that can be read [pixels].
_LETTERS, _SMALLEST = 0.032, 13
_INK, _MUTED, _SHADE = (240, 243, 246), (190, 203, 212), (10, 20, 28, 165)
_FORCE_NAMES = {"drag": "drag", "added_mass": "added mass", "load": "added by the cause"}


@dataclass(frozen=True)
class Caption:
    """The words over the pictures of a stretch.

    Attributes:
        title: whose run it is.
        legend: colour and words of every fish, then of every force.
        notes: how it is shown.
    """

    title: str
    legend: tuple[tuple[Colour, str], ...]
    notes: tuple[str, ...]


def caption_of(stretch: Stretch, instants: Sequence[float] | None = None) -> Caption:
    """Return the words of a stretch; of a still, with its instants [s]."""
    drawing = stretch.drawing
    part = {None: "", True: ", held-out run", False: ", fitted run"}[drawing.held_out]
    title = f"{drawing.source}{part or ','} {drawing.name}" if drawing.source else drawing.name
    legend = []
    for figure in drawing.figures:
        ghost = " (joints as commanded)" if figure.ghost else ""
        error = "" if figure.error is None else f", error {percent(figure.error, 2)}".replace("\N{NO-BREAK SPACE}", " ")
        legend.append((COLOURS[figure.swimmer][:3], f"{figure.words}{ghost}{error}"))
    kinds = [kind for kind in FORCES if any(kind in figure.arrows for figure in drawing.figures)]
    legend += [(FORCES[kind][:3], f"force: {_FORCE_NAMES[kind]}") for kind in kinds]
    shown = []
    if instants is not None:
        shown.append(f"at {', '.join(f'{time:.2f}' for time in instants)} s")
    elif stretch.slowdown > 1:
        shown.append(f"{stretch.start:.1f} to {stretch.end:.1f} s, {stretch.slowdown} times slower than swum")
    else:
        shown.append(f"{stretch.start:.1f} to {stretch.end:.1f} s, as fast as swum")
    if stretch.anchored:
        shown.append(f"all begin at one place at {stretch.start:.1f} s")
    if kinds:
        bearers = [figure.words for figure in drawing.figures if figure.arrows]
        on = f" on the fish {bearers[0]}" if len(drawing.figures) > 1 else ""
        shown.append(f"forces{on}, 1 N is {100.0 * drawing.scale:.3g} cm")
        if _cut(stretch):
            shown.append(f"cut at {100.0 * LONG * drawing.length:.0f} cm")
    return Caption(title, tuple(legend), tuple(shown))


def _cut(stretch: Stretch) -> bool:
    """Return whether an arrow is longer than what is drawn of it."""
    for figure in stretch.drawing.figures:
        within = (figure.time >= stretch.start) & (figure.time <= stretch.end)
        for _, vectors in figure.arrows.values():
            if np.any(np.linalg.norm(vectors[within], axis=2) > LONG * stretch.drawing.length):
                return True
    return False


def captioned(picture: NDArray[np.uint8], caption: Caption, time: float | None = None) -> Image.Image:
    """Return a picture (height, width, 3) with its caption, and the time [s] if there is one."""
    image = Image.fromarray(picture).convert("RGB")
    draw = ImageDraw.Draw(image, "RGBA")
    size = max(_SMALLEST, round(_LETTERS * image.height))
    font, small = ImageFont.load_default(size), ImageFont.load_default(max(_SMALLEST, round(0.85 * size)))
    margin, width = size, image.width - 2 * size
    gap = 1.4 * size

    def wide(entry: tuple[Colour, str]) -> float:
        return size + draw.textlength(entry[1], font=small)

    lines = _lines(caption.legend, lambda line: sum(map(wide, line)) + gap * (len(line) - 1), width)
    draw.rectangle((0, 0, image.width, margin + round(1.5 * size) * (1 + len(lines))), fill=_SHADE)
    draw.text((margin, 0.6 * margin), caption.title, font=font, fill=_INK)
    if time is not None:
        draw.text((image.width - margin, 0.6 * margin), f"{time:.2f} s", font=font, fill=_INK, anchor="ra")
    y = 0.6 * margin + 1.6 * size
    for line in lines:
        x = 0.0
        for entry in line:
            draw.ellipse((margin + x, y + 0.12 * size, margin + x + 0.7 * size, y + 0.82 * size), fill=entry[0])
            draw.text((margin + x + size, y), entry[1], font=small, fill=_INK)
            x += wide(entry) + gap
        y += 1.5 * size
    notes = _lines(caption.notes, lambda line: draw.textlength("; ".join(line), font=small), width)
    top = image.height - round(1.35 * size * len(notes) + 0.6 * size)
    draw.rectangle((0, top, image.width, image.height), fill=_SHADE)
    for k, note in enumerate(notes):
        draw.text((margin, top + 0.35 * size + 1.35 * size * k), "; ".join(note), font=small, fill=_MUTED)
    return image


def _lines(items: Sequence[Item], length: Callable[[Sequence[Item]], float], width: float) -> list[list[Item]]:
    """Return the items in lines that are not longer than the width, one item a line at least."""
    lines: list[list[Item]] = []
    for item in items:
        if lines and length([*lines[-1], item]) <= width:
            lines[-1].append(item)
        else:
            lines.append([item])
    return lines
