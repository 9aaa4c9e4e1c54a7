"""Added mass by the Keulegan-Carpenter number: a section that beats far loses some of it."""

from __future__ import annotations

from typing import Any

import numpy as np

from mjfish.effects.beat_amplitude import keulegan_carpenter
from mjfish.effects.effect import Effect, Fingerprint
from mjfish.effects.momentum_rate import added_mass_excess
from mjfish.hydro.load import load
from mjfish.parameters import Parameter


@load(memory=8)
def _excess(link: Any, parameters: Any) -> tuple[float, ...]:
    """Return the force of the missing added mass, and the rates of y, s and of the lags of both momenta."""
    height = np.sqrt(4.0 * link.added[0] / (np.pi * link.density * link.length))
    number = keulegan_carpenter(link.memory[1], height)
    excess = -parameters[0] * number**2 / (number**2 + parameters[1] ** 2)
    return added_mass_excess(link, excess)


class AddedMassAmplitude(Effect):
    """The added mass goes with the amplitude of the beat: c_m -> c_m (1 - a KC^2 / (KC^2 + K^2)).

    KC = 2 pi A / h is the Keulegan-Carpenter number of a link: h its height in the mean square, A the amplitude of its
    middle over the last beats (see `mjfish.effects.beat_amplitude`). a is the loss of a link that beats far, K the
    number at which half of it is lost. Vortices that a section has shed carry its momentum away: cylinders lose most
    of their added mass at KC about 12, and plates gain some, a < 0. Inertia matrices know no past, so the difference
    acts as a force, through lags of 9 ms (see `mjfish.effects.momentum_rate`).
    """

    name, domain, mechanism = "added_mass_amplitude", "water", "added_mass"
    summary = "the added mass falls with the amplitude of the beat"
    parameters = (
        Parameter("added_mass_amplitude.loss", "-", 0.0, -1.0, 0.75, 0.0, 0.1, about="a, of a link that beats far"),
        Parameter("added_mass_amplitude.half", "-", 5.0, 1.0, 20.0, 5.0, 1.0, about="K, KC of half of it", shape=True),
    )
    source = (
        "Keulegan and Carpenter, J. Res. Nat. Bur. Standards 60 (1958); Sarpkaya, J. Fluids Eng. 98 (1976): cylinders"
    )
    signature = "links that beat far, and turns, are lighter than a start from rest and than slow beats"
    confirm = "swing the held fish in water at several amplitudes and measure the force at the turns"
    fingerprint = Fingerprint(exponent=0.0, odd=False, part="everywhere")
    resembles = ("design-no-start",)
    load = _excess
