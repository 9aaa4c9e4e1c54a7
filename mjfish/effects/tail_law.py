"""Elastic deflection of the caudal link by a law that is learned from the data."""

from __future__ import annotations

import numpy as np

from mjfish.effects.effect import Fingerprint, TailForm, Values
from mjfish.fish import Fish
from mjfish.parameters import Parameter
from mjfish.parameters.prior import Prior


class TailLaw(TailForm):
    """The last link bends back about its joint by an odd and rising moment that is learned.

        M = (delta + b delta |delta| + a delta^3) / compliance + damping delta'
        a = h + min(b, 0)^2 / 3,   h >= 0

    so that dM / d delta > 0 whatever b and h are: 1 + 2 b x + 3 a x^2 has no root. A spring that gives way ever more
    and then stiffens is b < 0, one that stiffens at once b > 0, and `TailHardening` is b = 0.
    """

    name = "tail_law"
    learned = True
    summary = "the tail bends like a spring, by a law that is learned"
    parameters = (
        Parameter(
            "tail_law.compliance", "rad/(N m)", 0.0, 0.0, 2.0, 0.0, 0.05, about="deflection per torque, if small"
        ),
        Parameter("tail_law.damping", "N m s/rad", 0.02, 0.0, 0.2, 0.1, 0.02, about="of the deflection", shape=True),
        Parameter("tail_law.quadratic", "1/rad", 0.0, -10.0, 30.0, 1.0, 1.0, about="b, of its moment", shape=True),
        Parameter("tail_law.hardening", "1/rad2", 0.0, 0.0, 300.0, 10.0, 10.0, about="h, of its moment", shape=True),
    )
    source = "Kovacic and Brennan, The Duffing Equation (2011), ch. 2: springs with odd powers"
    signature = "the tail lags and gives way, by another share of its load at slow beats than at fast ones"
    fingerprint = Fingerprint(exponent=None, odd=False, part="everywhere")

    def body(self, fish: Fish, values: Values) -> Fish:
        """Add the compliance to the fish's own; the other numbers are those of the sum."""
        softening = min(values["quadratic"], 0.0)
        return fish.model_copy(
            update={
                "tail_compliance": fish.tail_compliance + values["compliance"],
                "tail_damping": values["damping"],
                "tail_quadratic": values["quadratic"],
                "tail_hardening": values["hardening"] + softening**2 / 3.0,
            }
        )

    def like(self, formula: str, values: Values) -> dict[str, float]:
        """Return the law at the numbers of a formula."""
        if formula not in ("tail_compliance", "tail_hardening"):
            return {}
        same = {"compliance": values["compliance"], "damping": values["damping"]}
        return {**same, "quadratic": 0.0, "hardening": values.get("hardening", 0.0)}

    def priors(self) -> tuple[Prior, ...]:
        """A deflection of a quarter of a radian makes a spring a few times as stiff, not more."""
        return (
            Prior("tail_law.quadratic", ("tail_law.quadratic",), np.eye(1), 10.0),
            Prior("tail_law.hardening", ("tail_law.hardening",), np.eye(1), 100.0),
        )
