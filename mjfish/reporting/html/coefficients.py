"""The coefficients of the nominal and of the extended model, with their intervals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mjfish.diagnosis import Diagnosis, Estimate
from mjfish.parameter import Parameter
from mjfish.reporting.html.words import estimate, interval, unit


@dataclass(frozen=True)
class Whisker:
    """An estimate and its interval in percent of the width of a drawing."""

    at: float
    low: float
    high: float


@dataclass(frozen=True)
class Fitted:
    """A fitted number as a page shows it."""

    estimate: str
    interval: str
    at_bound: bool
    whisker: Whisker


@dataclass(frozen=True)
class CoefficientView:
    """One line of the table; None where a model does not have the parameter."""

    name: str
    about: str
    unit: str
    bounds: str
    nominal: Fitted | None
    extended: Fitted | None


def coefficient_views(diagnosis: Diagnosis) -> tuple[CoefficientView, ...]:
    """Return one line a parameter of the extended model."""
    declared = {p.name: p for p in (*diagnosis.nominal_model.parameters, *diagnosis.extended_model.parameters)}
    names = [*diagnosis.nominal, *(name for name in diagnosis.extended if name not in diagnosis.nominal)]
    extended = diagnosis.extended if diagnosis.best else {}
    return tuple(_view(name, diagnosis.nominal, extended, declared.get(name)) for name in names)


def _view(
    name: str, nominal: Mapping[str, Estimate], extended: Mapping[str, Estimate], parameter: Parameter | None
) -> CoefficientView:
    both = [table[name] for table in (nominal, extended) if name in table]
    low, high = min(one.low for one in both), max(one.high for one in both)
    return CoefficientView(
        name=name,
        about=parameter.about if parameter else "",
        unit=unit(both[0].unit),
        bounds=f"{parameter.low:g} to {parameter.high:g}" if parameter else "",
        nominal=_fitted(nominal.get(name), low, high),
        extended=_fitted(extended.get(name), low, high),
    )


def _fitted(one: Estimate | None, low: float, high: float) -> Fitted | None:
    """Return the estimate placed on a line from `low` to `high`, with a margin at both ends."""
    if one is None:
        return None
    width = max(high - low, 1e-300)

    def place(value: float) -> float:
        return round(6.0 + 88.0 * min(max((value - low) / width, 0.0), 1.0), 2)

    return Fitted(
        estimate(one), interval(one), one.at_bound, Whisker(place(one.estimate), place(one.low), place(one.high))
    )
