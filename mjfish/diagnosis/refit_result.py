"""A refit: causes fitted together with the coefficients, and what that explains."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

from mjfish.block_angular import span
from mjfish.effects.effect import Effect
from mjfish.estimation import Fit, Problem
from mjfish.estimation.fit import fit_or_raise
from mjfish.estimation.smoothness import effective_degrees_of_freedom

#: Relative change of the sum of squares at which a refit stops.
TOLERANCE = 1e-5


@dataclass(frozen=True, eq=False)
class Refit:
    """Causes fitted together with the coefficients.

    Attributes:
        effects: the causes, the last one added last.
        problem: of the extended model.
        fit: its result.
        gain: fall of the sum of squares against the fit of the nominal model, LR.
    """

    effects: tuple[Effect, ...]
    problem: Problem
    fit: Fit
    gain: float

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the causes."""
        return tuple(effect.name for effect in self.effects)

    @property
    def learned(self) -> bool:
        """Whether the form of a cause is learned."""
        return any(effect.learned for effect in self.effects)

    @property
    def mechanisms(self) -> tuple[str, ...]:
        """Names of the mechanisms of the causes, sorted."""
        return tuple(sorted({effect.mechanism for effect in self.effects}))

    @functools.cached_property
    def degrees_of_freedom(self) -> float:
        """Number of parameters that the causes add; a shape to which the fit does not respond is not counted.

        Of a learned form, the effective number: priors take the place of data.
        """
        responds = {p.name for p, own in zip(self.fit.parameters, self.fit.lengths, strict=True) if own > 0.0}
        formulas = (p for effect in self.effects if not effect.learned for p in effect.parameters)
        learned = [p.name for effect in self.effects if effect.learned for p in effect.parameters]
        plain = sum(not p.shape or p.name in responds for p in formulas)
        return plain + effective_degrees_of_freedom(self.problem, self.fit, learned) if learned else plain

    @functools.cached_property
    def promise(self) -> float:
        """What a step more may gain where the fit was stopped: the part of the residual that its derivatives span."""
        if self.fit.status != "stopped":
            return 0.0
        return span(self.fit.jacobian.chosen(~self.fit.at_bound)).explained(self.fit.residual)

    @property
    def adjusted(self) -> float:
        """The gain less two for every parameter beyond the first: what sets of different size compare on."""
        return self.gain - 2.0 * (self.degrees_of_freedom - 1)

    def less(self, out: Effect) -> Refit:
        """Refit without one of several causes, from where the others and the coefficients are."""
        kept = tuple(effect for effect in self.effects if effect.name != out.name)
        left = tuple(effect for effect in self.problem.model.effects if effect.name != out.name)
        problem = replace(self.problem, model=replace(self.problem.model, effects=left))
        here = fit_or_raise(problem, problem.start(self.fit.values), tolerance=TOLERANCE)
        return Refit(kept, problem, here, self.gain + self.fit.sse - here.sse)
