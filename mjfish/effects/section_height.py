"""An outline that is higher or lower than measured."""

from __future__ import annotations

from mjfish.effects.calibration import CALIPERS
from mjfish.effects.effect import Effect, Fingerprint, Values
from mjfish.fish import Fish
from mjfish.parameters import Parameter


class SectionHeight(Effect):
    """Every section is h (1 + error) high: drag across goes with h, added mass with h^2, friction with the perimeter.

    Where coefficients are free this is nearly a gauge: c_d (1 + error), c_m (1 + error)^2 and c_f times the growth of
    the perimeter are the same fish. What is left is that perimeters of links which share a c_f grow unequally, since
    their sections differ in width over height. It shows once coefficients are held.
    """

    name, domain, mechanism = "section_height", "water", "added_mass"
    summary = "the sections are higher or lower than measured"
    parameters = (
        Parameter("section_height.error", "-", 0.0, -0.5, 1.0, 0.0, 0.05, about="relative error of all heights"),
    )
    source = "[Yu2016] eqs. (8)-(11): strips of height h, m_a = c_m rho pi h^2 / 4"
    signature = "like larger coefficients of every kind at once; nearly all of it goes into them"
    confirm = "measure the height of the sections with callipers"
    fingerprint = Fingerprint(exponent=0.0, odd=False, part="everywhere")
    calibration = CALIPERS

    def body(self, fish: Fish, values: Values) -> Fish:
        """Scale every height."""
        factor = 1.0 + values["error"]
        sections = tuple(
            section.model_copy(update={"height": (factor * section.height[0], factor * section.height[1])})
            for section in fish.sections
        )
        return fish.model_copy(update={"sections": sections})
