"""Every candidate, scored, with what the numbers mean in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mjfish.diagnose import Candidate, Diagnosis, Estimate
from mjfish.diagnose.select import GOODNESS
from mjfish.effects import Effect, catalogue
from mjfish.report.words import chance, estimate, interval, number, percent, unit

#: A refit that hides more of a signature than this leaves little to see.
_HIDDEN = 0.9


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
    chosen = {cause.name for cause in diagnosis.causes} | {name for group in diagnosis.rivals for name in group}
    return tuple(_view(one, diagnosis, effects, chosen) for one in diagnosis.candidates)


def _view(one: Candidate, diagnosis: Diagnosis, effects: Mapping[str, Effect], chosen: set[str]) -> CandidateView:
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
        smallest_visible=_visible(one, effects),
        parameters=parameter_views(one.parameters or {}),
        remark=" ".join(filter(None, [_verdict(one, diagnosis, effects), *_cautions(one)])),
    )


def _visible(one: Candidate, effects: Mapping[str, Effect]) -> tuple[str, ...]:
    """Return, per amplitude, the size that would have shown, with its unit."""
    units = {p.name: p.unit for p in effects[one.name].parameters} if one.name in effects else {}
    return tuple(
        f"{name.rpartition('.')[2]} {number(size, 2)} {unit(units.get(name, '-'))}".strip()
        for name, size in (one.smallest_visible or {}).items()
    )


def _verdict(one: Candidate, diagnosis: Diagnosis, effects: Mapping[str, Effect]) -> str:
    """Say in a sentence why the candidate is, or is not, the cause."""
    if not one.applicable:
        return f"Not tried: {one.remark}."
    if one.parameters is None:
        visible = " and ".join(_visible(one, effects))
        return f"No sign of it.{f' It would have shown from {visible} on.' if visible else ''}"
    if any(one.name == cause.name for cause in diagnosis.causes):
        return "The cause: with it in the model nothing systematic is left."
    if any(one.name in group for group in diagnosis.rivals):
        return "Possible: the data cannot tell it from its rivals, and with it nothing systematic is left."
    if diagnosis.verdict == "cannot_tell" and (one.name,) in diagnosis.alternatives:
        return "Possible: it explains no more than chance might, and with it nothing systematic is left."
    if one.rival_p is not None and one.fit_p is None:
        return f"Ruled out: {' with '.join(diagnosis.best)} explains the misfit better by more than chance allows."
    if one.fit_p is not None and one.fit_p < GOODNESS:
        return "Close, but with it in the model something systematic is left."
    if one.held_out_gain is not None and one.held_out_gain <= 0.0:
        return "Fits, but makes the held-out trials no better."
    return ""


def _cautions(one: Candidate) -> list[str]:
    cautions = []
    if one.applicable and one.absorbed > _HIDDEN:
        cautions.append(
            f"A refit of the coefficients hides {percent(one.absorbed, 2)} of what it does: these trials say little."
        )
    stuck = [name for name, value in (one.parameters or {}).items() if value.at_bound]
    if stuck:
        cautions.append(f"On its bound: {', '.join(stuck)}.")
    if one.applicable and one.remark:
        cautions.append(one.remark)
    return cautions
