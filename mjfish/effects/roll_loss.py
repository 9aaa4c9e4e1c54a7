"""A rolling fish pushes less to the side."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from mjfish.data import Trial
from mjfish.effects.effect import Effect, Fingerprint, variant
from mjfish.effects.roll import GRAVITY
from mjfish.fish import Fish
from mjfish.hydro.force import crossflow
from mjfish.hydro.load import load
from mjfish.parameters import Parameter


@load(memory=2, shared=True)
def _lost(link: Any, parameters: Any) -> tuple[float, float, float, float, float]:
    """Return what the drag across loses, and what the link adds to the rates of lean and of s.

    Parameters are lambda^2, omega, zeta, kappa, mu; a height, which is not read; the weight.
    """
    square, frequency, damping, weight = parameters[0], parameters[1], parameters[2], parameters[6]
    lean, s = link.memory[0], link.memory[1]
    force, moment = crossflow(link.v, link.w, link.length, link.node_height, link.height_moment)
    across = -0.5 * link.density * link.c_d
    aside = np.cos(link.bend)
    momentum = parameters[3] * link.c_m * (link.added[0] * link.v + link.added[1] * link.w) * aside
    coupling = frequency * frequency / weight
    swing = coupling * across * force * aside
    if link.first == 1.0:
        nose = parameters[4] * weight / GRAVITY
        momentum -= nose * link.v
        swing += coupling * nose * link.w * link.u
    turn = -coupling * momentum
    swing += 2.0 * damping * frequency * coupling * momentum
    if link.last == 1.0:
        turn += s
        swing -= 2.0 * damping * frequency * s + frequency * frequency * lean
    lost = -(np.sin(np.sqrt(square) * lean) ** 2)
    return 0.0, lost * across * force, lost * across * moment, turn, swing


class RollLoss(Effect):
    """The body rolls by phi, and the drag across it falls to cos^2 phi of what it was.

    The side force F of the water leans the fish, a pendulum on its weight m g, by phi = lambda psi,

        psi'' + 2 zeta omega psi' + omega^2 psi = omega^2 F / (m g),    F = sum of cos beta (drag - kappa p'),

    with the drag across every link, its added momentum p across, of which the share kappa acts beside the axis of the
    roll, and its heading beta relative to the head. With s = psi' + omega^2 sum kappa cos beta p / (m g) no p' is
    needed; psi and s are zero where a run begins. A pendulum that the side force drives at its axis has lambda = 1. The
    camera is left alone; what it reads of a rolling marker is the cause `Roll`.
    """

    name, domain, mechanism = "roll_loss", "out_of_plane", "roll"
    summary = "the fish rolls, and its drag across falls"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("roll_loss.square", "-", 0.0, 0.0, 400.0, 0.0, 0.3, about="lambda^2, of the lean by the side force"),
        Parameter(
            "roll_loss.frequency", "rad/s", 8.0, 1.0, 60.0, 8.0, 1.0, about="natural frequency of the roll", shape=True
        ),
        Parameter("roll_loss.damping", "-", 0.3, 0.02, 3.0, 0.3, 0.05, about="damping ratio of the roll", shape=True),
        Parameter("roll_loss.inertial", "-", 0.5, 0.0, 1.0, 0.5, 0.2, about="kappa, of the added momentum", shape=True),
    )
    source = (
        "Cross-flow principle: Hoerner, Fluid-Dynamic Drag (1965), ch. 3; metacentric stability: Fossen, Handbook of "
        "Marine Craft Hydrodynamics and Motion Control (2011), ch. 4"
    )
    signature = "sway and yaw rate too small where the beat is strong; quick start-ups slip"
    confirm = "film the fish from ahead, or log its roll with an inertial sensor"
    fingerprint = Fingerprint(odd=False, part="everywhere")
    load = _lost
    weight: ClassVar[float] = 10.0  # [N]

    @classmethod
    def for_fish(cls, fish: Fish) -> Effect:
        """Return the effect with the weight of the fish."""
        return variant(cls, weight=GRAVITY * sum(link.mass for link in fish.links))

    def constants(self, trial: Trial) -> tuple[float, ...]:
        """Return mu, the height of the marker and the weight."""
        del trial
        return 0.0, 0.0, self.weight
