"""The result of a diagnosis: what its text, figures and page are made of, and what it computed with."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from mjfish.data import Dataset, Sensor, Trial
from mjfish.diagnosis.description import Description
from mjfish.diagnosis.forms import NamedMechanism
from mjfish.diagnosis.held_out import Gain
from mjfish.diagnosis.isolability import Isolability
from mjfish.diagnosis.missing_force import MissingForce
from mjfish.diagnosis.next_steps import CAUTIONS, next_steps
from mjfish.diagnosis.setup import Setup
from mjfish.diagnosis.table import Estimate, Row, Table, estimates
from mjfish.diagnosis.where import Where
from mjfish.effects import Effect
from mjfish.effects.mechanism import Domain
from mjfish.estimation import Fit, Noise, Problem
from mjfish.estimation.omnibus import beat_phase
from mjfish.files import checksummed_json
from mjfish.files.plain_data import plain, unsaved
from mjfish.files.result import Result
from mjfish.inspection import Inspection
from mjfish.model import Model
from mjfish.model.extended import Extended, with_values
from mjfish.model.origin import with_origin
from mjfish.model.posterior import Posterior
from mjfish.numerics.arrays import BoolArray, FloatArray
from mjfish.numerics.formats import percent

Verdict = Literal["named", "nothing_wrong", "cannot_tell", "unexplained"]
#: Of ``diagnosis.json``; a file of another schema is refused.
SCHEMA = 5


@dataclass(frozen=True)
class Cause:
    """A named cause: its effect's name and the estimates of its parameters by short name."""

    name: str
    summary: str
    parameters: Mapping[str, Estimate]

    @classmethod
    def of(cls, effect: Effect, fit: Fit, model: Model) -> Cause:
        """Return a cause with its estimates in a fitted model."""
        found = estimates(fit, model)
        return cls(effect.name, effect.summary, {p.short: found[p.name] for p in effect.parameters})


@dataclass(frozen=True)
class Candidate:
    """One candidate: whether the data can show it, its score, and its row in the table of evidence.

    Attributes:
        name: of the effect.
        applicable: whether this dataset can show it at all; `remark` says why not.
        score: T of the score test at the nominal fit; 0 of a learned form, which is not scored there.
        score_p: p value of the score, were the nominal model true.
        confounded: share of its signature that a refit of the coefficients hides.
        minimum_detectable: size of each amplitude that would have shown; None where no score says: of what is not
            smooth at its null, and of what the coefficients hide.
        remark: in words.
        failure: why it could not be tried (`mjfish.diagnosis.failures`); empty where it was, or does not apply.
        row: what its refit says, in the table of evidence; None where it was not refitted.
    """

    name: str
    applicable: bool
    score: float = 0.0
    score_p: float = 1.0
    confounded: float = 0.0
    minimum_detectable: Mapping[str, float] | None = None
    remark: str = ""
    failure: str = ""
    row: Row | None = unsaved(default=None)

    @property
    def evidence(self) -> float:
        """Fall of the sum of squares when it is fitted together with the coefficients; its score where it was not."""
        return self.score if self.row is None else self.row.gain


@dataclass(frozen=True)
class FittedModel:
    """A model at its fit to the fit trials; the next experiment is planned from it.

    Attributes:
        causes: names of the effects that extend the nominal model; none of the nominal model itself.
        values: estimates of all free parameters by full name, those of single trials too.
        at_bound: names of those that rest on a bound.
        sse: sum of squared whitened residuals.
        step: integration step of the model [s].
        converged: whether the fit was followed to its optimum.
    """

    causes: tuple[str, ...]
    values: Mapping[str, float]
    at_bound: tuple[str, ...]
    sse: float
    step: float
    converged: bool

    @classmethod
    def of(cls, causes: tuple[str, ...], problem: Problem, fit: Fit) -> FittedModel:
        """Return a model at its fit."""
        at_bound = tuple(p.name for p, held in zip(fit.parameters, fit.at_bound, strict=True) if held)
        return cls(causes, fit.values, at_bound, fit.sse, problem.model.step, fit.status == "converged")


@dataclass(frozen=True, eq=False)
class SensorOverlay:
    """What one sensor of a trial measured, and what both models predict it to read; (m, c) at its own samples."""

    sensor: Sensor
    nominal: FloatArray
    extended: FloatArray


@dataclass(frozen=True, eq=False)
class Overlay:
    """One trial as measured and as both models predict it, for pictures.

    Attributes:
        trial: the measured trial; where places were measured, with the velocities of the smoothed path.
        held_out: whether it was kept out of the fits.
        nominal: (n, 3) prediction of the nominal model, to seven decimals.
        extended: (n, 3) prediction of the extended model (the best candidate's, even where it was not named).
        counted: (n,) whether fits and scores look at a sample (see `mjfish.estimation.Problem.mask`): not beside a step
            of the drive, nor, where joint angles were measured, near both ends of the trial.
        phase: (n,) of the beat of the last joint [rad].
        sensors: what every sensor of the trial measured, and is predicted to read.
    """

    trial: Trial
    held_out: bool
    nominal: FloatArray
    extended: FloatArray
    counted: BoolArray
    phase: FloatArray
    sensors: tuple[SensorOverlay, ...] = ()

    @classmethod
    def of(
        cls,
        model: Model,
        trial: Trial,
        predicted: tuple[FloatArray, FloatArray],
        sensors: tuple[SensorOverlay, ...] = (),
        *,
        held_out: bool,
    ) -> Overlay:
        """Return a trial with what the nominal model and the extended one predict (n, 3)."""
        counted = Problem(model, (trial,), Noise.white(np.ones(3))).mask(0)
        nominal, extended = (np.round(velocity, 7) for velocity in predicted)
        phase = np.round(beat_phase(model.fish.cpg, trial), 6)
        return cls(trial, held_out, nominal, extended, counted, phase, sensors)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class DiagnosisData(Result):
    """What a diagnosis says, as plain data: its text, its tables, its figures and its page are made of this alone.

    `Diagnosis` has it as it was computed, `SavedDiagnosis` as a file has it.

    Attributes:
        setup: what was compared with what.
        verdict: ``named``, ``nothing_wrong``, ``cannot_tell`` or ``unexplained``.
        message: the verdict in one sentence.
        status: ``ok``, or what went wrong on the way (``fit_not_converged``, or ``failed``: see `failures`).
        remarks: what a reader should know: noise, bounds, what was left out.
        candidates: every cause scored, best first.
        failures: parts of the diagnosis that failed, candidates among them by name, and why; with any, the verdict is
            neither ``named`` nor ``nothing_wrong``.
        nominal: coefficients of the nominal model by name.
        extended: coefficients and effect parameters of the extended model by full name.
        overlays: every trial, measured and predicted.
        fits: the nominal model, then every candidate that was fitted together with the coefficients.
        provenance: versions, seed, hashes of the inputs.
        checks: what is to be known of the data before physics is blamed.
        p_wrong: p value of the nominal model.
        causes: named ones, together.
        mechanisms: of the named causes: what acts, as deep as the data say it, with its curves.
        domain: where it acts, where rivals of one domain stay and no more than that is sure; else None.
        rivals: groups of names that the data cannot tell apart.
        alternatives: every set of causes that stays: the named one, or those that the data cannot tell apart.
        certain: the causes that all of these have: the named ones, or what several sets share.
        undetectable: causes that these data cannot show, with the reason.
        isolability: sizes from which each mechanism is told from every other one on these runs.
        best: names of the causes that the extended model has: the named ones, else the best candidate; empty where
            nothing is wrong.
        closest: the cause that comes closest where the verdict is ``unexplained``; empty else, or where none was
            refitted.
        where: where the discrepancy sits.
        force: the missing generalised force of every fitted trial, with its band; empty where nothing is wrong.
        description: forces that describe what no cause explains; only where it is ``unexplained``.
        gain: on held-out trials; None where there are none. Where nothing is wrong both models are the nominal one.
        table: every set of causes that was compared, with the numbers that the verdict was read from.
    """

    setup: Setup
    verdict: Verdict
    message: str
    status: str
    remarks: tuple[str, ...]
    candidates: tuple[Candidate, ...]
    failures: Mapping[str, str]
    nominal: Mapping[str, Estimate]
    extended: Mapping[str, Estimate]
    overlays: tuple[Overlay, ...]
    fits: tuple[FittedModel, ...]
    provenance: Mapping[str, Any]
    checks: Inspection = field(default_factory=Inspection)
    p_wrong: float = math.nan
    causes: tuple[Cause, ...] = ()
    mechanisms: tuple[NamedMechanism, ...] = ()
    domain: Domain | None = None
    rivals: tuple[tuple[str, ...], ...] = ()
    alternatives: tuple[tuple[str, ...], ...] = ()
    certain: tuple[str, ...] = ()
    undetectable: Mapping[str, str] = field(default_factory=dict)
    isolability: Isolability = field(default_factory=Isolability)
    best: tuple[str, ...] = ()
    closest: str = ""
    where: Where | None = None
    force: tuple[MissingForce, ...] = ()
    description: Description | None = None
    gain: Gain | None = None
    table: Table = field(default_factory=Table)

    @property
    def next(self) -> tuple[str, ...]:
        """What to do next, the most important first."""
        return tuple(next_steps(self))

    @property
    def delays(self) -> tuple[str, ...]:
        """By how much the joints of the extended model are late at the beat, in words."""
        best = (row for row in self.table.rows if {*row.names} == {*self.best})
        return tuple(f"{delay.told} at {beat}" for row in best for beat, delay in row.delays.items())

    @property
    def caution(self) -> str:
        """What a status that is not ok means; empty where it is ok."""
        return CAUTIONS.get(self.status, "")

    @property
    def held_out(self) -> str:
        """The error on held-out trials in words; empty where there are none."""
        if self.gain is None:
            return ""
        before, after = (percent(errors["pooled"]) for errors in (self.gain.nominal, self.gain.extended))
        if not self.best:
            return f"nRMSE {before} of the nominal model, which was not extended"
        return f"nRMSE {before} before, {after} after: {self.gain.change}"

    def summary(self) -> str:
        """Return verdict, causes with sizes and curves, gain, status and what to do next, in at most ten lines."""
        lines = [f"{self.setup.dataset}: {self.verdict}. {self.message}"]
        if self.caution:
            lines.append(f"{self.status}: {self.caution}")
        own = {f"{cause.name}.{name}": value for cause in self.causes for name, value in cause.parameters.items()}
        shown = own.keys() - self.setup.knots
        lines += [f"  {name} = {value.told}" for name, value in own.items() if name in shown]
        lines += [f"  delay of the joints: {told}" for told in self.delays]
        if self.verdict == "cannot_tell" and self.rivals:
            lines.append(f"  rivals: {'; '.join(', '.join(group) for group in self.rivals)}")
        if self.gain is not None:
            lines.append(f"  held out: {self.held_out}")
        lines += [f"  {finding.severity}: {finding.message}" for finding in self.checks.blocks]
        lines += [f"  {curve.summary()}" for mechanism in self.mechanisms for curve in mechanism.curves]
        return "\n".join([*lines[:9], f"Next: {self.next[0]}."])


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Diagnosis(DiagnosisData):
    """What is wrong with the simulation of a dataset, why, and what knowing it gains.

    Beside what a reader sees, which `DiagnosisData` lists, it has what it was computed with.

    Attributes:
        dataset: that was diagnosed.
        nominal_model, extended_model: ready to predict.
        problem: of the nominal model on the fit trials, with the noise that the fits were made under.
        effects: candidates by name.
        posterior: what the fit of the extended model says of its parameters, for draws (`mjfish.sample`); None where
            it diverged or failed.
    """

    dataset: Dataset
    nominal_model: Model
    extended_model: Model
    problem: Problem
    effects: Mapping[str, Effect]
    posterior: Posterior | None = None

    @property
    def fish(self) -> Extended:
        """The fish with the causes that explain most, and random ones, at the estimates: `mjfish.simulate` takes it."""
        model, sizes = self.extended_model, dict(self.extended)
        for row in self.table.random:
            model, sizes = model.extended(self.effects[row.names[0]]), sizes | dict(row.sizes)
        values = Extended(model, {name: value.estimate for name, value in sizes.items()}).values
        unnamed = f" Not named: {', '.join(self.best)}, which explains most." if self.best and not self.causes else ""
        outcome = f"{self.verdict}: {self.message}{unnamed}"
        intervals = {name: (value.low, value.high) for name, value in sizes.items() if value.settled}
        fish = with_origin(with_values(model.fish, values), self.dataset, outcome, intervals)
        return Extended(replace(model, fish=fish), values)

    def _public_name(self, cause: str) -> str:
        """Return the name of a cause for other programs: that of its mechanism, where its form is learned."""
        effect = self.effects.get(cause)
        return effect.mechanism if effect is not None and effect.learned else cause

    def to_dict(self) -> dict[str, Any]:
        """Return the diagnosis as plain data, the content of ``diagnosis.json``."""
        kept = (
            "verdict", "message", "status", "remarks", "causes", "mechanisms", "domain", "rivals", "alternatives",
            "certain", "candidates", "next", "failures", "undetectable", "isolability", "checks", "description",
            "p_wrong", "table", "where", "fits", "posterior", "provenance", "best", "closest", "overlays",
        )  # fmt: skip
        setup = plain(self.setup)
        content = {
            "schema": SCHEMA,
            "dataset": setup.pop("dataset"),
            **{name: plain(getattr(self, name)) for name in kept},
            "causes": [{**plain(cause), "name": self._public_name(cause.name)} for cause in self.causes],
            "missing_force": plain(self.force),
            "gain": plain(self.gain),
            "coefficients": {"nominal": plain(self.nominal), "extended": plain(self.extended)},
            "problem": {**self.problem.to_dict(), **setup},
        }
        return {**content, "sha256": checksummed_json.digest(content)}
