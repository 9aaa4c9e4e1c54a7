"""Elastic deflection of the caudal link."""

from __future__ import annotations

from typing import ClassVar

from mjfish.effects.calibration import SPRING_BALANCE, Calibration
from mjfish.effects.effect import Effect, Fingerprint, Values
from mjfish.effects.mechanism import Domain
from mjfish.fish import Fish
from mjfish.parameter import Parameter


class TailCompliance(Effect):
    """The last link bends back elastically about its joint: angle = driven angle + delta.

    The deflection has the link's inertia and the fluid on it: the torque that the joint passes on is
    -delta / compliance - damping delta', and equals the moment of the link's equation of motion about the joint.
    """

    name: ClassVar[str] = "tail_compliance"
    domain: ClassVar[Domain] = "body"
    mechanism: ClassVar[str] = "tail_flexibility"
    summary: ClassVar[str] = "the tail bends like a spring"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("tail_compliance.compliance", "rad/(N m)", 0.0, 0.0, 2.0, 0.0, 0.05, about="deflection per torque"),
        Parameter(
            "tail_compliance.damping", "N m s/rad", 0.02, 0.0, 0.2, 0.1, 0.02, about="of the deflection", shape=True
        ),
    )
    source: ClassVar[str] = "[Yu2016] sec. V-B: the undulating tail is not completely rigid"
    signature: ClassVar[str] = (
        "the tail lags and gives way in proportion to its load: the error grows as frequency squared"
    )
    confirm: ClassVar[str] = "hold the peduncle, load the fin with a spring balance and read the deflection"
    fingerprint: ClassVar[Fingerprint] = Fingerprint(exponent=2.0, odd=False, part="everywhere")
    calibration: ClassVar[Calibration | None] = SPRING_BALANCE
    smooth: ClassVar[bool] = False
    least: ClassVar[float] = (
        0.02  # a tail that is stiffer than this asks for a step that is shorter than any data can see
    )

    def body(self, fish: Fish, values: Values) -> Fish:
        """Add the compliance to the fish's own."""
        return fish.model_copy(
            update={
                "tail_compliance": fish.tail_compliance + values["compliance"],
                "tail_damping": values["damping"],
            }
        )
