"""An outline that is higher or lower than measured."""

from __future__ import annotations

from typing import ClassVar

from mjfish.effects.calibration import CALIPERS, Calibration
from mjfish.effects.effect import Effect, Fingerprint, Values
from mjfish.effects.mechanism import Domain
from mjfish.fish import Fish
from mjfish.parameter import Parameter


class SectionHeight(Effect):
    """Every section is h (1 + error) high: drag across goes with h, added mass with h^2, friction with the perimeter.

    Where coefficients are free this is nearly a gauge: c_d (1 + error), c_m (1 + error)^2 and c_f times the growth of
    the perimeter are the same fish. What is left is that perimeters of links which share a c_f grow unequally, since
    their sections differ in width over height. It shows once coefficients are held.
    """

    name: ClassVar[str] = "section_height"
    domain: ClassVar[Domain] = "water"
    mechanism: ClassVar[str] = "added_mass"
    summary: ClassVar[str] = "the sections are higher or lower than measured"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("section_height.error", "-", 0.0, -0.5, 1.0, 0.0, 0.05, about="relative error of all heights"),
    )
    source: ClassVar[str] = "[Yu2016] eqs. (8)-(11): strips of height h, m_a = c_m rho pi h^2 / 4"
    signature: ClassVar[str] = "like larger coefficients of every kind at once; nearly all of it goes into them"
    confirm: ClassVar[str] = "measure the height of the sections with callipers"
    fingerprint: ClassVar[Fingerprint] = Fingerprint(exponent=0.0, odd=False, part="everywhere")
    calibration: ClassVar[Calibration | None] = CALIPERS

    def body(self, fish: Fish, values: Values) -> Fish:
        """Scale every height."""
        factor = 1.0 + values["error"]
        sections = tuple(
            section.model_copy(update={"height": (factor * section.height[0], factor * section.height[1])})
            for section in fish.sections
        )
        return fish.model_copy(update={"sections": sections})
