"""Where the score of a cause is largest among its shapes: a fit that begins elsewhere may end in another minimum.

At the null a shape does nothing, and no data say what it is. The score statistic T(s) of the amplitudes at shapes s
says at which of them the cause would explain most, to first order ([Davies1977]); a sweep over a grid, one shape at a
time, finds it.

[Davies1977] R. Davies, Biometrika 64: hypothesis testing when a parameter is present only under the alternative.
"""

from __future__ import annotations

import copy
import functools
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.diagnosis.evidence import Evidence, signature_rows
from mjfish.effects.effect import Effect
from mjfish.parameter import Parameter
from mjfish.sized_cache import always

#: Values of a shape that are tried: so many, or where its bounds are wide, a factor apart. A resonance is narrow.
_VALUES, _FACTOR = 3, 1.45
#: Sweeps over all shapes, where there are several.
_SWEEPS = 2


def at_best_shapes(
    evidence: Evidence, effect: Effect, *, first_alone: bool = False
) -> tuple[Evidence, dict[str, float]]:
    """Return the evidence of one candidate at the shapes of its largest score, and these shapes by full name.

    The defaults are among the values tried.

    Args:
        evidence: of the model without the candidate.
        effect: the candidate.
        first_alone: leave all shapes but the first at their defaults.
    """
    shapes = {p.name: p.default for p in effect.parameters if p.shape}
    (best,) = _scored(evidence, effect, [shapes])
    declared = [p for p in effect.parameters if p.shape][: 1 if first_alone else None]
    for _ in range(_SWEEPS if len(declared) > 1 else 1):
        before = dict(shapes)
        for p in declared:
            tried = [{**shapes, p.name: float(value)} for value in _grid(p)]
            for there, at in zip(_scored(evidence, effect, tried), tried, strict=True):
                if there.statistic(effect.name) > best.statistic(effect.name):
                    best, shapes = there, at
        if shapes == before:
            break
    return best, shapes


def _scored(evidence: Evidence, effect: Effect, tried: Sequence[dict[str, float]]) -> Iterator[Evidence]:
    """Yield the evidence of one candidate at each of these shapes, from one rollout that has them all.

    Args:
        evidence: of the model without the candidate.
        effect: the candidate.
        tried: shapes by full name.
    """
    problem, width = evidence.problem, len(effect.amplitudes())
    twins = [_renamed(effect, f"{effect.name}_{k}") for k in range(len(tried))]
    shapes = {
        f"{twin.name}.{name.partition('.')[2]}": value
        for twin, own in zip(twins, tried, strict=True)
        for name, value in own.items()
    }
    stacked = signature_rows(problem, evidence.fit.values, twins, shapes)
    for k in range(len(tried)):
        raw = stacked[:, k * width : (k + 1) * width]
        projected = evidence.coefficients.off(raw)
        yield replace(
            evidence,
            candidates=(effect,),
            amplitudes=(effect.amplitudes(),),
            score=projected.T @ evidence.cleared,
            information=projected.T @ projected,
            raws=always(raw),
        )


@functools.lru_cache(maxsize=512)
def _renamed(effect: Effect, name: str) -> Effect:
    """Return a candidate under another name, so that a model may have it several times; it is of its fish already."""
    parameters = tuple(replace(p, name=f"{name}.{p.short}") for p in effect.parameters)
    own = {"name": name, "parameters": parameters, "for_fish": classmethod(lambda _cls, _fish: None)}
    twin = copy.copy(effect)
    twin.__class__ = type(name, (type(effect),), own)
    return twin


def _grid(p: Parameter) -> FloatArray:
    """Return the values of a shape that are tried, over its bounds."""
    if p.wide:
        return np.geomspace(p.low, p.high, 1 + int(np.ceil(np.log(p.high / p.low) / np.log(_FACTOR))))
    return np.linspace(p.low, p.high, _VALUES)
