"""Elastic deflection of the caudal link that grows less than its load."""

from __future__ import annotations

from mjfish.effects.effect import Fingerprint, TailForm, Values
from mjfish.fish import Fish
from mjfish.parameters import Parameter


class TailHardening(TailForm):
    """The last link bends back about its joint, ever stiffer: M = delta (1 + h delta^2) / compliance + damping delta'.

    A beam of large deflection, or a joint that runs into its stop; h = 0 is the linear spring of `TailCompliance`. The
    moment is odd and grows with the deflection for h >= 0.
    """

    name = "tail_hardening"
    summary = "the tail bends like a spring that hardens with its load"
    parameters = (
        Parameter("tail_hardening.compliance", "rad/(N m)", 0.0, 0.0, 2.0, 0.0, 0.05, about="deflection per torque"),
        Parameter("tail_hardening.damping", "N m s/rad", 0.02, 0.0, 0.2, 0.1, 0.02, about="of it", shape=True),
        Parameter("tail_hardening.hardening", "1/rad2", 10.0, 0.0, 300.0, 10.0, 10.0, about="h, of it", shape=True),
    )
    source = "Duffing's equation: Kovacic and Brennan (2011), ch. 2"
    signature = "the tail gives way at small load and less so at large: it shows most at slow beats"
    limits = ("tail_compliance",)
    fingerprint = Fingerprint(exponent=None, odd=False, part="everywhere")

    def body(self, fish: Fish, values: Values) -> Fish:
        """Add the compliance to the fish's own."""
        return fish.model_copy(
            update={
                "tail_compliance": fish.tail_compliance + values["compliance"],
                "tail_damping": values["damping"],
                "tail_hardening": values["hardening"],
            }
        )

    def like(self, formula: str, values: Values) -> dict[str, float]:
        """Return the numbers at which it is the linear spring."""
        return {**values, "hardening": 0.0} if formula == "tail_compliance" else {}
