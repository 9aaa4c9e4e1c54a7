"""Where the coefficients of a fish come from: the body and the runs that they were fitted to, and their intervals."""

from __future__ import annotations

from collections.abc import Container
from typing import Literal

from mjfish.files.tomlfile import Table

#: In place of a body: the coefficients may be used on any.
ANY = "any"
#: Lower and upper end.
Span = tuple[float, float]
Quantity = Literal["speed", "beat", "amplitude"]
Range = dict[Quantity, Span]


class Identified(Table):
    """The table ``identified`` of a fish TOML.

    Attributes:
        geometry: `mjfish.Fish.geometry` of the body that the coefficients belong to, or ``any``.
        dataset: that they were fitted to.
        by: version of mjfish.
        outcome: of the fit, in words.
        range: least and most over the fitted runs: ``speed``, the mean surge of the second half of a run [m/s];
            ``beat``, its frequency [Hz]; ``amplitude``, half of the widest swing of a joint [rad]. What no run shows is
            left out.
        intervals: 95 % intervals by full name, of coefficients, free numbers of the body, and causes. What was not
            fitted, or what the data do not say, has none.
    """

    geometry: str
    dataset: str
    by: str
    outcome: str
    range: Range
    intervals: dict[str, Span]

    def after(self, changed: Container[str], geometry: str) -> Identified:
        """Return the record of a fish with other numbers: those that changed are no estimates, and have no interval."""
        kept = {name: ends for name, ends in self.intervals.items() if name not in changed}
        body = ANY if self.geometry == ANY else geometry
        return self.model_copy(update={"geometry": body, "intervals": kept})

    def __hash__(self) -> int:
        """Return a hash: a fish is a key of what was computed with it."""
        return hash((self.geometry, self.dataset, self.outcome))
