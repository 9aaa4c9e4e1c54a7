"""A fish that is heavier or lighter than its table: a gauge."""

from __future__ import annotations

from mjfish.effects.effect import Effect, Fingerprint, Values
from mjfish.fish import Fish
from mjfish.parameters import Parameter


class MassError(Effect):
    """Masses and inertias of all links are (1 + error) times the table's.

    A gauge: the equation of motion (M + M_ad) V' = f - gamma is homogeneous of degree 1 in masses, inertias and the
    nine coefficients together, so that V(m (1 + error), c) = V(m, c / (1 + error)), exactly. While all nine are free a
    refit absorbs it without trace; it shows once one of them is known, from a tow test or another fish. An elastic
    tail, linear drag or lift, which have sizes of their own, scale along with it.
    """

    name, domain, mechanism = "mass_error", "body", "mass_distribution"
    summary = "masses and inertias are off by one factor"
    parameters = (
        Parameter("mass_error.error", "-", 0.0, -0.5, 1.0, 0.0, 0.05, about="relative error of masses and inertias"),
    )
    source = "homogeneity of the equation of motion, [Yu2016] eq. (18), in m, I and the coefficients"
    signature = "none while all coefficients are free: they all come out wrong by one factor"
    confirm = "weigh the fish, or measure one coefficient in a tow tank"
    fingerprint = Fingerprint(exponent=0.0, odd=False, part="everywhere")
    resembles = ("design-no-start",)

    def body(self, fish: Fish, values: Values) -> Fish:
        """Scale masses and inertias."""
        factor = 1.0 + values["error"]
        links = tuple(
            link.model_copy(update={"mass": factor * link.mass, "inertia": factor * link.inertia})
            for link in fish.links
        )
        return fish.model_copy(update={"links": links})
