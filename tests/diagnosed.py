"""A small diagnosis made by hand, in every verdict: what reports and logs show, without the work of finding it."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mjfish.data import Dataset, Trial
from mjfish.diagnosis import (
    Candidate,
    Cause,
    Diagnosis,
    Estimate,
    FittedModel,
    Overlay,
    Split,
    SplitMechanism,
    Splits,
)
from mjfish.diagnosis.curves import Axis, Band, MeasuredCurve
from mjfish.diagnosis.description import Description, Term
from mjfish.diagnosis.forms import NamedMechanism
from mjfish.diagnosis.held_out import Confirmation, Gain
from mjfish.diagnosis.isolability import Isolability
from mjfish.diagnosis.missing_force import MissingForce
from mjfish.diagnosis.result import Verdict
from mjfish.diagnosis.setup import Setup
from mjfish.diagnosis.table import Comparison, Row, Table
from mjfish.diagnosis.where import Where
from mjfish.drive.cpg import DriveSegment
from mjfish.effects import catalogue, find
from mjfish.estimation import Noise, Problem
from mjfish.fish import Fish, load_fish
from mjfish.inspection import Inspection
from mjfish.model import Model
from mjfish.model.posterior import Posterior
from mjfish.reporting.html.diagnosis import render_diagnosis

CAUSE = "servo_lag"
#: A clock that only large servo delays are told from, walls that nothing shows.
ISOLABILITY = Isolability(
    mechanisms=("clock", "servo_dynamics", "walls"),
    amplitudes=("time_offset.offset", "servo_delay.time", "wall_effect.size"),
    units=("s", "s", "-"),
    sizes=((8e-5, 1.2e-3, 8.2e-5), (4e-4, 8e-5, 8e-5), (np.inf, np.inf, np.inf)),
)
LAG = Estimate(0.0201, 0.0195, 0.0207, "s")
SIGMA = np.array([0.01, 0.01, 0.05])
_GAIN = Gain(
    nominal={"surge": 0.031, "sway": 0.021, "yaw_rate": 0.0423, "pooled": 0.0314},
    extended={"surge": 0.011, "sway": 0.012, "yaw_rate": 0.0130, "pooled": 0.0120},
    relative_reduction=0.618,
    low=0.57,
    high=0.66,
    mean_speed_error=(0.0123, 0.0021),
)


def _trial(
    name: str, omega: float, cause: str, values: Mapping[str, float], seed: int
) -> tuple[Trial, np.ndarray, np.ndarray]:
    """Return a measured trial with the predictions of both models."""
    fish = load_fish("pike")
    time = np.arange(0.0, 2.001, 0.02)
    turn = DriveSegment(1.2, omega, (0.0, 0.2, 0.3, 0.4))
    empty = Trial(name, None, time, np.zeros((len(time), 3)), (DriveSegment(0.0, omega, (0.0,) * 4), turn))
    model = Model(fish)
    nominal = model.predict(empty, model.values()).velocity
    wide = model.extended(find(cause))
    extended = wide.predict(empty, wide.values(values)).velocity
    noise = SIGMA * np.random.default_rng(seed).normal(size=extended.shape)
    return replace(empty, velocity=extended + noise), nominal, extended


def diagnosis(
    verdict: Verdict = "named",
    *,
    held_out: bool = True,
    names: tuple[str, str] = ("slow", "fast"),
    cause: str = CAUSE,
    parameters: Mapping[str, Estimate] | None = None,
    mechanisms: tuple[NamedMechanism, ...] = (),
) -> Diagnosis:
    """Return a diagnosis of two trials, the second held out (or both fitted), with this verdict and best cause."""
    fish = load_fish("pike")
    own = {"time_constant": LAG} if parameters is None else parameters
    of_cause = {f"{cause}.{short}": estimate for short, estimate in own.items()}
    values = {name: estimate.estimate for name, estimate in of_cause.items()}
    runs = zip(names, (14.0, 20.0), strict=True)
    trials = [_trial(name, omega, cause, values, k) for k, (name, omega) in enumerate(runs)]
    overlays = [
        Overlay.of(Model(fish), trial, (before, after), held_out=held_out and k == 1)
        for k, (trial, before, after) in enumerate(trials)
    ]
    wrong = verdict != "nothing_wrong"
    if not wrong:
        overlays = [replace(overlay, extended=overlay.nominal) for overlay in overlays]
    nominal = {name: Estimate(v, 0.9 * v, 1.1 * v, "-", name == "c_f.head") for name, v in fish.values.items()}
    dataset = Dataset("pool week 12", fish, tuple(overlay.trial for overlay in overlays), noise=SIGMA)
    fitted = tuple(overlay.trial for overlay in overlays if not overlay.held_out)
    problem = Problem(Model(fish), fitted, Noise.white(SIGMA))
    models = (Model(fish), Model(fish).extended(find(cause)) if wrong else Model(fish))
    return Diagnosis(
        setup=Setup.of(dataset, problem, models, catalogue().values()),
        dataset=dataset,
        verdict=verdict,
        message=f"Something to say about {verdict}.",
        status="ok",
        remarks=("c_f.head of the nominal model is at its bound",),
        checks=Inspection(),
        undetectable={"mass_error": "a refit of the coefficients hides all of it"},
        isolability=ISOLABILITY,
        causes=(Cause(cause, find(cause).summary, own),) if verdict == "named" else (),
        mechanisms=mechanisms,
        domain=None,
        rivals=((cause, "time_offset"),) if verdict == "cannot_tell" else (),
        alternatives={"named": ((cause,),), "cannot_tell": ((cause,), ("time_offset",))}.get(verdict, ()),
        certain=(cause,) if verdict == "named" else (),
        candidates=_candidates(verdict),
        table=Table(1e-9 if wrong else 0.63, Comparison({row.names: row for row in _rows(verdict)})),
        failures={},
        best=(cause,) if wrong else (),
        closest=cause if verdict == "unexplained" else "",
        where=_where(names) if wrong else None,
        force=tuple(_force(trial) for trial in (overlay.trial for overlay in overlays)) if wrong else (),
        description=Description((Term("a moment on every link ~ u v", -0.2, 0.9),), 0.6)
        if verdict == "unexplained"
        else None,
        p_wrong=1e-9 if wrong else 0.63,
        gain=None
        if not held_out
        else _GAIN
        if wrong
        else replace(_GAIN, extended=_GAIN.nominal, relative_reduction=0.0),
        nominal=nominal,
        extended={**nominal, **of_cause} if wrong else nominal,
        nominal_model=models[0],
        extended_model=models[1],
        posterior=_posterior(fish, {**nominal, **of_cause} if wrong else nominal, (cause,) if wrong else ()),
        overlays=tuple(overlays),
        problem=problem,
        fits=_fits(fish.values, {cause: values, "time_offset": {"time_offset.offset": -0.0195}} if wrong else {}),
        effects=catalogue(),
        provenance={"versions": {"mjfish": "0.1.0"}, "commit": None, "seed": 7, "inputs": {"slow.csv": "ab12"}},
    )


@functools.cache
def page(verdict: Verdict = "named", *, held_out: bool = True) -> str:
    """Return the report of the diagnosis with this verdict, rendered once: drawing it takes half a second."""
    return render_diagnosis(diagnosis(verdict, held_out=held_out))


def splits() -> Splits:
    """Return three splits: one names two mechanisms, one leaves rivals, one cannot be diagnosed."""
    gain = diagnosis().gain
    assert gain is not None
    named = (SplitMechanism("servo_dynamics", "form"), SplitMechanism("roll", "mechanism"))
    rivals = (SplitMechanism("roll", "certain"), SplitMechanism("current", "not_named"))
    return Splits(
        diagnosis(),
        20,
        (
            Split(("b", "c"), ("a",), True, "named", "", named, gain),
            Split(("a", "c"), ("b",), False, "cannot_tell", "", rivals, replace(gain, relative_reduction=-0.02)),
            Split(("a", "b"), ("<c>",), False, None, "too <few> numbers"),
        ),
    )


def _posterior(fish: Fish, estimates: Mapping[str, Estimate], causes: tuple[str, ...]) -> Posterior:
    """Return independent errors as large as the intervals say, without scatter."""
    sigma = np.array([(value.high - value.low) / 4.0 for value in estimates.values()])
    return Posterior(
        model=Model(fish, tuple(find(name) for name in causes)),
        names=tuple(estimates),
        mean=np.array([value.estimate for value in estimates.values()]),
        covariance=np.diag(sigma**2),
        scatter=np.zeros(len(sigma)),
        runs=2,
    )


#: Points of `drag_curve` [m/s], and the two of them between which runs have been.
SPEEDS = np.geomspace(0.01, 1.0, 25)
VISITED = (float(SPEEDS[8]), float(SPEEDS[20]))


def drag_curve(
    quantity: str = "c_d",
    group: str = "body",
    *,
    visited: tuple[float, float] = VISITED,
    freedom: float | None = None,
) -> MeasuredCurve:
    """Return a coefficient that falls with the speed, with a band that opens where no run has been."""
    y = {"head": 0.9, "body": 1.2, "tail": 1.5}[group] * SPEEDS**-0.25
    half = 0.05 + 0.3 * np.abs(np.log10(SPEEDS / 0.2)) ** 3
    return MeasuredCurve(
        quantity,
        group,
        Axis("speed", "m/s", tuple(SPEEDS)),
        Band(quantity, "-", tuple(y), tuple(y - half), tuple(y + half)),
        (2.0,) * len(SPEEDS),
        visited,
        freedom,
    )


def drag_law(*, forms: tuple[str, ...] = ("reynolds_drag", "linear_drag")) -> NamedMechanism:
    """Return a drag law whose form is not settled; no run says anything of the friction of the head."""
    curves = [drag_curve("c_d", group) for group in ("head", "body", "tail")]
    curves += [drag_curve("c_f", "head", visited=(0.0, 0.0)), drag_curve("c_f", "body")]
    return NamedMechanism("drag_law", "water", "mechanism", "learned", forms, tuple(curves))


def learned_diagnosis() -> Diagnosis:
    """Return a diagnosis that names a drag law of learned form: shape numbers, and the values of two curves."""
    values = {
        p.short: Estimate(p.default, p.default - 0.1, p.default + 0.1, p.unit) for p in find("drag_law").parameters
    }
    return diagnosis(cause="drag_law", parameters=values, mechanisms=(drag_law(),))


def _fits(coefficients: Mapping[str, float], refits: Mapping[str, Mapping[str, float]]) -> tuple[FittedModel, ...]:
    """Return the nominal model and those with one cause, all with the same coefficients."""
    return tuple(
        FittedModel(causes, {**coefficients, **values}, ("c_f.head",), 1000.0, 0.005, converged=True)
        for causes, values in [((), {}), *(((name,), values) for name, values in refits.items())]
    )


def _force(trial: Trial) -> MissingForce:
    """Return a force that beats, with a band of a tenth of it."""
    beat = np.sin(14.0 * trial.time)[:, None] * np.array([0.1, 0.4, 0.02])
    band = np.full_like(beat, 0.1) * np.array([0.1, 0.4, 0.02])
    return MissingForce(trial.name, trial.time, beat, band, np.array([1.0, 2.0, 0.1]))


def _where(names: tuple[str, str]) -> Where:
    return Where(
        channel="yaw_rate",
        trial=names[0],
        part="start-up",
        phase="0/8 to 1/8",
        speed="lowest fifth",
        turn="highest fifth",
        channels={"surge": 0.2, "sway": 0.3, "yaw_rate": 0.5},
        trials={names[0]: 1.0},
        parts={"start-up": 0.75, "steady": 0.25},
        phases={"0/8 to 1/8": 0.6, "4/8 to 5/8": 0.4},
        speeds={"lowest fifth": 0.6, "highest fifth": 0.4},
        turns={"lowest fifth": 0.3, "highest fifth": 0.7},
    )


def row(names: tuple[str, ...], gain: float, behind: float, rival_p: float, fit_p: float | None = None) -> Row:
    """Return the row of a set of causes, tested where p of what it leaves is given."""
    tests = {} if fit_p is None else {"candidates": 0.4, "waves": fit_p}
    known = [find(name) for name in names]
    return Row(
        names=names,
        causes={effect.name: effect.summary for effect in known},
        mechanisms=tuple(sorted(effect.mechanism for effect in known)),
        learned=False,
        gain=gain,
        degrees_of_freedom=len(names),
        adjusted=gain,
        behind=behind,
        rival_p=rival_p,
        tests=tests,
        excess=0.1 * gain if tests else np.inf,
        held_out=Confirmation(210.0, 0.4) if tests else None,
        chosen=float(behind == 0.0),
    )


def _rows(verdict: Verdict) -> list[Row]:
    """Return rows of the candidates that were refitted."""
    return [candidate.row for candidate in _candidates(verdict) if candidate.row is not None]


def _candidates(verdict: Verdict) -> tuple[Candidate, ...]:
    """Return a best one, a rival, one that is ruled out, and one that does not apply."""
    visible = {f"{CAUSE}.time_constant": 5.8e-5}
    wall = Candidate("ambient_current", False, remark="the heading was not recorded")
    if verdict == "nothing_wrong":
        return (Candidate(CAUSE, True, 0.3, 0.57, confounded=0.4, minimum_detectable=visible), wall)
    close, fit_p = 0.4 if verdict == "cannot_tell" else 1e-7, 0.00005 if verdict == "unexplained" else 0.31
    best = Candidate(CAUSE, True, 812.0, 1e-99, confounded=0.12, minimum_detectable=visible)

    def alone(name: str, gain: float, rival_p: float, size: str, value: Estimate) -> Row:
        own = row((name,), gain, 903.4 - gain, rival_p, fit_p if rival_p > 0.05 else None)
        return replace(own, sizes={f"{name}.{size}": value})

    off = Estimate(-0.0195, -0.0201, -0.0189, "s")
    damping = Estimate(0.2, 0.2, 0.2, "N m s/rad", at_bound=True)
    return (
        replace(best, row=alone(CAUSE, 903.4, 1.0, "time_constant", LAG)),
        replace(best, name="time_offset", confounded=0.97, row=alone("time_offset", 640.0, close, "offset", off)),
        replace(best, name="tail_compliance", row=alone("tail_compliance", 88.0, 0.00025, "damping", damping)),
        wall,
    )
