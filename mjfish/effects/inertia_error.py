"""Yaw inertias of the links that are not those of the table."""

from __future__ import annotations

from mjfish.effects.effect import Effect, Fingerprint, Values
from mjfish.fish import Fish
from mjfish.parameters import Parameter


class InertiaError(Effect):
    """Every link's yaw inertia about its centre of mass is I (1 + error); masses and centres of mass are right.

    Inertias are the numbers of a fish that are weighed least: they come from a drawing, or from two point masses. All
    have the same error, since they come from the same drawing; what shows is mostly that of the heaviest link.
    """

    name, domain, mechanism = "inertia_error", "body", "mass_distribution"
    summary = "the yaw inertias of the links are off"
    parameters = (
        Parameter("inertia_error.error", "-", 0.0, -0.6, 1.5, 0.0, 0.05, about="relative error of all yaw inertias"),
    )
    source = "[Yu2016] Table I, whose head would need 95 % of its mass at its two ends"
    signature = "yaw rate and sway within the beat are too large or too small, alike at every frequency"
    confirm = "hang the head on two threads and time its swing about the vertical (bifilar pendulum)"
    fingerprint = Fingerprint(exponent=0.0, odd=False, part="everywhere")
    resembles = ("design-no-start",)

    def body(self, fish: Fish, values: Values) -> Fish:
        """Scale every inertia."""
        factor = 1.0 + values["error"]
        links = tuple(link.model_copy(update={"inertia": factor * link.inertia}) for link in fish.links)
        return fish.model_copy(update={"links": links})
