"""A centre of mass of the head that is not where the table has it."""

from __future__ import annotations

from mjfish.data import Dataset
from mjfish.effects.effect import Effect, Fingerprint, Values, variant
from mjfish.fish import Fish
from mjfish.parameters import Parameter

#: Bounds and scale of the shift, as shares of the length of the head; and the share of the way to its ends at most.
_REACH, _SCALE, _WITHIN = 0.275, 0.017, 0.95


def _shift(reach: float, scale: float) -> Parameter:
    return Parameter(
        "com_offset.shift", "m", 0.0, -reach, reach, 0.0, scale, about="of the head's com, towards the tail"
    )


class ComOffset(Effect):
    """The head's centre of mass lies `shift` further towards the tail; its inertia about it stays.

    Only the head's: battery, ballast and electronics sit there, and are moved whenever the fish is trimmed or charged.
    A joint link is a servo in a shell, whose centre its drawing gives. About the nose the head's moment of mass becomes
    m (c + shift), its inertia I + m (c + shift)^2.
    """

    name, domain, mechanism = "com_offset", "body", "mass_distribution"
    summary = "the head's centre of mass is elsewhere"
    parameters = (_shift(0.08, 0.005),)
    source = "parallel-axis theorem (Steiner); [Yu2016] eq. (6): moment of mass m c of a link"
    signature = "sway and yaw rate within the beat shift against each other, alike at every frequency"
    confirm = "balance the head on an edge and read its centre of mass"
    fingerprint = Fingerprint(exponent=0.0, odd=False, part="everywhere")

    @classmethod
    def for_fish(cls, fish: Fish) -> Effect | None:
        """Return the effect with bounds and scale in proportion to the head, and within it."""
        head = fish.links[0]
        reach = min(_REACH * head.length, _WITHIN * head.com, _WITHIN * (head.length - head.com))
        if not reach > 0.0:
            return None
        return variant(cls, parameters=(_shift(float(f"{reach:.2g}"), float(f"{_SCALE * head.length:.2g}")),))

    def not_applicable(self, dataset: Dataset) -> str:
        """A head whose centre of mass lies outside of it cannot have this cause."""
        head, (shift,) = dataset.fish.links[0], self.parameters
        if shift.low <= -head.com or head.com + shift.high >= head.length:
            return f"the head's centre of mass, {head.com:g} m from its front, is not inside its {head.length:g} m"
        return ""

    def body(self, fish: Fish, values: Values) -> Fish:
        """Move the head's centre of mass."""
        head = fish.links[0]
        moved = head.model_copy(update={"com": head.com + values["shift"]})
        return fish.model_copy(update={"links": (moved, *fish.links[1:])})
