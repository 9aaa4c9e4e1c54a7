"""The added mass learned from the data: a smooth function of the amplitude of the beat."""

from __future__ import annotations

from typing import Any

import numpy as np

from mjfish.effects.beat_amplitude import keulegan_carpenter
from mjfish.effects.effect import Effect, Fingerprint, Values
from mjfish.effects.momentum_rate import added_mass_excess
from mjfish.hydro.load import load
from mjfish.hydro.spline import spline
from mjfish.parameters import Parameter
from mjfish.parameters.prior import Prior, smooth_curve

#: KC of the first knot, number of knots, an octave apart.
_FIRST, _KNOTS = 0.5, 6
#: Bounds of the logarithm of the factor.
_LOW, _HIGH = -1.5, 0.7


@load(memory=8)
def _excess(link: Any, parameters: Any) -> tuple[float, ...]:
    """Return the force of the added mass beyond c_m, and the rates of y, s and of the lags of both momenta."""
    height = np.sqrt(4.0 * link.added[0] / (np.pi * link.density * link.length))
    excess = np.expm1(spline(np.log2(keulegan_carpenter(link.memory[1], height) / _FIRST), parameters, 0, _KNOTS))
    return added_mass_excess(link, excess)


def _name(knot: int) -> str:
    return f"knot_{knot}"


class AddedMassLaw(Effect):
    """The added mass is a smooth function of the amplitude of the beat: c_m -> c_m exp(g(log2 KC)).

    g is a cubic B-spline with knots an octave apart from KC 0.5 on, constant beyond the outermost ones; the same for
    all links, while c_m is that of the link's group. KC and the force are those of `AddedMassAmplitude`. The level of g
    is one with that of c_m; at one value of all knots it is another c_m.
    """

    name, domain, mechanism = "added_mass_law", "water", "added_mass"
    learned = True
    summary = "the added mass goes with the amplitude of the beat, learned"
    parameters = tuple(
        Parameter(
            f"added_mass_law.{_name(k)}", "-", 0.0, _LOW, _HIGH, 0.0, 0.1, about=f"ln c_m near KC {_FIRST * 2**k:g}"
        )
        for k in range(_KNOTS)
    )
    source = (
        "Sarpkaya, J. Fluids Eng. 98 (1976): inertia by KC; Eilers and Marx, Statistical Science 11 (1996): splines"
    )
    signature = "links that beat far are lighter or heavier than those that beat little, and than a start"
    confirm = "swing the held fish in water at several amplitudes and measure the force at the turns"
    fingerprint = Fingerprint(exponent=None, odd=False, part="everywhere")
    resembles = ("design-no-start", "design-short")
    load = _excess

    def like(self, formula: str, values: Values) -> dict[str, float]:
        """Return the curve at the numbers of a formula; a section's height is one with the level."""
        if formula == "section_height":
            level = float(np.clip(2.0 * np.log(1.0 + values["error"]), _LOW, _HIGH))
            return {_name(k): level for k in range(_KNOTS)}
        if formula != "added_mass_amplitude":
            return {}
        square = (_FIRST * 2.0 ** np.arange(_KNOTS)) ** 2
        logs = np.log(1.0 - values["loss"] * square / (square + values["half"] ** 2))
        return {_name(k): float(np.clip(log, _LOW, _HIGH)) for k, log in enumerate(logs)}

    def priors(self) -> tuple[Prior, ...]:
        """Keep the curve smooth."""
        return smooth_curve("added_mass_law.curve", [p.name for p in self.parameters], 0.3, 0.7)
