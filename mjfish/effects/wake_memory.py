"""A wake that is remembered: the force across a link follows its velocity late."""

from __future__ import annotations

from typing import Any

from mjfish.effects.effect import Effect, Fingerprint
from mjfish.hydro.force import crossflow
from mjfish.hydro.load import load
from mjfish.parameters import Parameter


@load(memory=2)
def _late(link: Any, parameters: Any) -> tuple[float, float, float, float, float]:
    """Return share (F_lag - F) of the drag across, and the rates of F_lag: its force and its moment."""
    share = parameters[0]
    time = parameters[1]
    force, moment = crossflow(link.v, link.w, link.length, link.node_height, link.height_moment)
    across = -0.5 * link.density * link.c_d
    late_force = link.memory[0]
    late_moment = link.memory[1]
    missing_force = across * force - late_force
    missing_moment = across * moment - late_moment
    return 0.0, -share * missing_force, -share * missing_moment, missing_force / time, missing_moment / time


class WakeMemory(Effect):
    """A share psi of the drag across a link comes late, through a first-order lag of time constant tau.

        F' = F + psi (F_lag - F),   tau F_lag' = F - F_lag,   F_lag = 0 where the run begins

    F is force and moment of the drag across each link. Vorticity has to be shed before drag is felt: the force on a
    bluff section grows over some chords of travel, as the lift of a foil does (Wagner's function is near
    1 - 0.165 exp(-0.045 s) - 0.335 exp(-0.3 s), s half-chords, two such lags). Here tau is a time, not a distance.
    """

    name, domain, mechanism = "wake_memory", "water", "wake_memory"
    summary = "drag across the body follows its motion late: the wake remembers"
    parameters = (
        Parameter("wake_memory.share", "-", 0.0, 0.0, 1.0, 0.0, 0.05, about="psi, of the drag that comes late"),
        Parameter("wake_memory.time", "s", 0.15, 0.02, 1.0, 0.15, 0.05, about="tau, of the lag", shape=True),
    )
    source = "Wagner, ZAMM 5 (1925): lift; Sarpkaya, AIAA J. 4 (1966): drag of a cylinder set in motion"
    signature = "the beat's sway and yaw rate are early and large; start-ups and turns overshoot"
    confirm = "hold the fish, step one joint and watch the side force settle after the joint has stopped"
    fingerprint = Fingerprint(exponent=None, odd=False, part="everywhere")
    resembles = ("design-no-start",)
    load = _late
