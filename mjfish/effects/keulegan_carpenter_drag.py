"""Drag across by the Keulegan-Carpenter number: a plate that beats less far has more of it."""

from __future__ import annotations

from typing import Any

import numpy as np

from mjfish.effects.beat_amplitude import TAU, keulegan_carpenter
from mjfish.effects.calibration import TOW_TEST
from mjfish.effects.effect import Effect, Fingerprint
from mjfish.hydro.force import KC_0
from mjfish.hydro.load import load
from mjfish.parameters import Parameter


@load(memory=4)
def _excess(link: Any, parameters: Any) -> tuple[float, float, float, float, float, float, float]:
    """Return the excess over a constant c_d, strip by strip, and the rates of y and s at both ends of the link."""
    power = parameters[0]
    front, rear = link.memory[0], link.memory[1]
    front_square, rear_square = link.memory[2], link.memory[3]
    across = 0.0
    moment = 0.0
    for k in range(link.coarse_r.shape[0]):
        r, height = link.coarse_r[k], link.coarse_height[k]
        place = r / link.length
        kc = (1.0 - place) * keulegan_carpenter(front_square, height) + place * keulegan_carpenter(rear_square, height)
        q = link.v + link.w * r
        share = link.coarse_weight[k] * height * (np.exp(-power * np.log(kc / KC_0)) - 1.0) * abs(q) * q
        across += share
        moment += share * r
    pressure = -0.5 * link.density * link.c_d
    return (
        0.0,
        pressure * across,
        pressure * moment,
        link.v - front / TAU,
        link.v + link.w * link.length - rear / TAU,
        (front * front - front_square) / TAU,
        (rear * rear - rear_square) / TAU,
    )


class KeuleganCarpenterDrag(Effect):
    """Drag across goes with the amplitude of the beat: c_d -> c_d (KC / KC_0)^-n, KC_0 = 3.

    KC = 2 pi A / h is the Keulegan-Carpenter number of a strip of height h that beats to the side with amplitude A.
    n = 0 is a constant coefficient; plates across the flow have c_d = 8 KC^(-1/3) at KC about 3. A is that of the last
    beats, from the lateral velocity v of the two ends of each link,

        y' = v - y / tau,    s' = (y^2 - s) / tau,    A^2 = 2 s,    tau = 0.5 s,    y = s = 0 where the run begins,

    and KC^2 = 0.3^2 + (2 pi A / h)^2 at either end is taken linearly between them. Mean and phase do not count: a
    steady slip to the side is an amplitude of sqrt(2) tau v.
    """

    name, domain, mechanism = "keulegan_carpenter_drag", "water", "drag_law"
    summary = "drag across falls with the amplitude of the beat"
    parameters = (Parameter("keulegan_carpenter_drag.power", "-", 0.0, -1.0, 1.5, 0.0, 0.1, about="n, of KC / 3"),)
    source = "Keulegan and Carpenter, J. Res. Nat. Bur. Standards 60 (1958); Graham, J. Fluid Mech. 97 (1980): plates"
    signature = "links that beat little, and the start of a run, have more drag across than the others"
    confirm = "swim at several amplitudes of the beat, or swing the held fish at several and measure it"
    fingerprint = Fingerprint(exponent=0.0, odd=False, part="everywhere")
    calibration = TOW_TEST
    resembles = ("design-no-start",)
    load = _excess
