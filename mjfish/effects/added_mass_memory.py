"""Added mass that remembers."""

from __future__ import annotations

from typing import Any

from mjfish.effects.effect import Effect, Fingerprint
from mjfish.hydro.load import load
from mjfish.parameters import Parameter


@load(memory=2)
def _late(link: Any, parameters: Any) -> tuple[float, float, float, float, float]:
    """Return -(share / tau) (p - p_lag), and the rates of p_lag: momentum and its moment."""
    rate = 1.0 / parameters[1]
    momentum = link.c_m * (link.added[0] * link.v + link.added[1] * link.w)
    moment = link.c_m * (link.added[1] * link.v + link.added[2] * link.w)
    settle = rate * (momentum - link.memory[0])
    settle_moment = rate * (moment - link.memory[1])
    return 0.0, -parameters[0] * settle, -parameters[0] * settle_moment, settle, settle_moment


class AddedMassMemory(Effect):
    """The added mass of slow motion exceeds that of fast motion by a share psi, with a lag of time constant tau.

        F = -psi p_lag',   tau p_lag' = p - p_lag,   p_lag = 0 where the run begins

    p is the added momentum of a link, of force and moment. Beside the added mass c_m of fast motion, the frequency
    response of the added mass is c_m (1 + psi / (1 + i omega tau)): of oscillating bodies near a surface and of
    sections that shed vortices it depends on the frequency (Cummins's equation has its kernel).
    """

    name, domain, mechanism = "added_mass_memory", "water", "wake_memory"
    summary = "the added mass follows the motion late: the water remembers"
    parameters = (
        Parameter("added_mass_memory.share", "-", 0.0, -1.0, 2.0, 0.0, 0.2, about="psi, excess of slow motion"),
        Parameter("added_mass_memory.time", "s", 0.15, 0.02, 1.0, 0.15, 0.05, about="tau, of the lag", shape=True),
    )
    source = "Cummins, Schiffstechnik 9 (1962): impulse response of the added mass"
    signature = "the beat's sway and yaw rate have another phase, by frequency; start-ups overshoot"
    confirm = "hold the fish, swing one joint at several frequencies and measure force and phase"
    fingerprint = Fingerprint(exponent=None, odd=False, part="everywhere")
    resembles = ("design-no-start",)
    load = _late
