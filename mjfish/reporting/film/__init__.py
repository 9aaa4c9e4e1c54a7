"""Films and stills of swimming fish, drawn by MuJoCo without a window.

In reading order: `stretch`, what of a run is shown and where the fish begin; `shot`, the camera and the stage;
`caption`, the words over a picture; `files`, what is written.
"""

from mjfish.reporting.film.files import SUFFIXES, write
from mjfish.reporting.film.stretch import BEATS, BEATS_OF_STILL, Stretch, beats, steady, whole, worst

__all__ = ["BEATS", "BEATS_OF_STILL", "SUFFIXES", "Stretch", "beats", "steady", "whole", "worst", "write"]
