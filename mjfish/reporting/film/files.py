"""Writing a stretch as a film (MP4, GIF) or as a still of several instants (PNG)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import imageio.v2 as imageio
import numpy as np
from PIL import Image

from mjfish.files import writing
from mjfish.reporting.film.caption import caption_of, captioned
from mjfish.reporting.film.shot import frames, still
from mjfish.reporting.film.stretch import Stretch

SUFFIXES = (".mp4", ".gif", ".png")
#: Pictures a second; those of a GIF last whole hundredths of a second.
_RATES = {".mp4": 30.0, ".gif": 20.0}
_SIZES = {".mp4": (1280, 720), ".gif": (720, 406), ".png": (1600, 560)}
#: Colours of a GIF.
_PALETTE = 256


def write(path: Path, stretch: Stretch, progress: Callable[[str, float], None] = lambda _what, _done: None) -> None:
    """Write a film or a still, by the suffix of `path`, whole or not at all.

    Args:
        path: ends in .mp4, .gif or .png; a file that is there is replaced.
        stretch: that is shown.
        progress: told what is done and the share that is.

    Raises:
        InputError: another suffix, the file cannot be written, or this machine cannot draw.
    """
    writing.check_suffix(path, *SUFFIXES)
    with writing.whole(path) as partial:
        if path.suffix.lower() == ".png":
            progress("drawing", 0.0)
            instants, picture = still(stretch, _SIZES[".png"])
            captioned(picture, caption_of(stretch, instants.tolist())).save(partial, optimize=True)
        else:
            _film(partial, stretch, progress)


def _film(path: Path, stretch: Stretch, progress: Callable[[str, float], None]) -> None:
    rate, caption = _RATES[path.suffix.lower()], caption_of(stretch)
    long = stretch.end - stretch.start
    pictures = (
        (time, captioned(picture, caption, time))
        for time, picture in frames(stretch, _SIZES[path.suffix.lower()], rate)
    )
    if path.suffix.lower() == ".gif":
        shown = []
        for time, image in pictures:
            progress("drawing", (time - stretch.start) / long)
            shown.append(image.quantize(_PALETTE, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE))
        first, *others = shown
        first.save(path, save_all=True, append_images=others, duration=round(1000.0 / rate), loop=0, optimize=False)
        return
    opened: Any = imageio.get_writer(path, fps=rate, codec="libx264", quality=7, macro_block_size=2)
    with opened as writer:
        for time, image in pictures:
            progress("drawing", (time - stretch.start) / long)
            writer.append_data(np.asarray(image))
