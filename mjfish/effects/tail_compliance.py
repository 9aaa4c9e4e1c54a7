"""Elastic deflection of the caudal link."""

from __future__ import annotations

from mjfish.effects.effect import Fingerprint, TailForm, Values
from mjfish.fish import Fish
from mjfish.parameters import Parameter


class TailCompliance(TailForm):
    """The last link bends back elastically about its joint: angle = driven angle + delta.

    The deflection has the link's inertia and the fluid on it: the torque that the joint passes on is
    -delta / compliance - damping delta', and equals the moment of the link's equation of motion about the joint.
    """

    name = "tail_compliance"
    summary = "the tail bends like a spring"
    parameters = (
        Parameter("tail_compliance.compliance", "rad/(N m)", 0.0, 0.0, 2.0, 0.0, 0.05, about="deflection per torque"),
        Parameter(
            "tail_compliance.damping", "N m s/rad", 0.02, 0.0, 0.2, 0.1, 0.02, about="of the deflection", shape=True
        ),
    )
    source = "[Yu2016] sec. V-B: the undulating tail is not completely rigid"
    signature = "the tail lags and gives way in proportion to its load: the error grows as frequency squared"
    fingerprint = Fingerprint(exponent=2.0, odd=False, part="everywhere")

    def body(self, fish: Fish, values: Values) -> Fish:
        """Add the compliance to the fish's own."""
        return fish.model_copy(
            update={
                "tail_compliance": fish.tail_compliance + values["compliance"],
                "tail_damping": values["damping"],
            }
        )
