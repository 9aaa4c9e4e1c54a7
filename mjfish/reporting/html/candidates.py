"""Every candidate, scored, with what the numbers mean in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mjfish.diagnosis import Candidate, Diagnosis, Estimate
from mjfish.effects import Effect, catalogue
from mjfish.reporting.html.judgement import cautions, judgement, visible
from mjfish.reporting.html.words import chance, estimate, interval, number, percent, unit


@dataclass(frozen=True)
class ParameterView:
    """A parameter as a page shows it."""

    name: str
    estimate: str
    interval: str
    unit: str
    at_bound: bool


@dataclass(frozen=True)
class CandidateView:
    """One line of the table of candidates; a dash stands for what was not computed."""

    name: str
    summary: str
    applicable: bool
    chosen: bool
    statistic: str
    freedom: int
    p_value: str
    rival_p: str
    fit_p: str
    held_out_gain: str
    absorbed: str
    smallest_visible: tuple[str, ...]
    parameters: tuple[ParameterView, ...]
    remark: str


def known_effects(diagnosis: Diagnosis) -> dict[str, Effect]:
    """Return the effects by name as far as they are known here: the shipped ones and those of the extended model."""
    return {**catalogue(), **{effect.name: effect for effect in diagnosis.extended_model.effects}}


def parameter_views(parameters: Mapping[str, Estimate]) -> tuple[ParameterView, ...]:
    """Return estimates as a page shows them."""
    return tuple(
        ParameterView(name, estimate(one), interval(one), unit(one.unit), one.at_bound)
        for name, one in parameters.items()
    )


def candidate_views(diagnosis: Diagnosis) -> tuple[CandidateView, ...]:
    """Return the lines of the table, best first."""
    effects = known_effects(diagnosis)
    chosen = {*diagnosis.certain, *(name for group in diagnosis.rivals for name in group)}
    return tuple(_view(one, diagnosis, effects, chosen) for one in diagnosis.candidates)


def _view(one: Candidate, diagnosis: Diagnosis, effects: Mapping[str, Effect], chosen: set[str]) -> CandidateView:
    shown = visible(one, effects)
    return CandidateView(
        name=one.name,
        summary=effects[one.name].summary if one.name in effects else "",
        applicable=one.applicable,
        chosen=one.name in chosen,
        statistic=number(one.statistic),
        freedom=one.freedom,
        p_value=chance(one.p_value),
        rival_p="–" if one.rival_p is None else chance(one.rival_p),
        fit_p="–" if one.fit_p is None else chance(one.fit_p),
        held_out_gain="–" if one.held_out_gain is None else number(one.held_out_gain),
        absorbed=percent(one.absorbed, 2),
        smallest_visible=shown,
        parameters=parameter_views(one.parameters or {}),
        remark=" ".join(filter(None, [judgement(one, diagnosis, shown), *cautions(one, diagnosis)])),
    )
