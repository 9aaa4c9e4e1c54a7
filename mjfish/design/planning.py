"""The plan of the next experiment: runs and calibrations ranked by what they would do for a question.

And a folder for the next run: a dataset that lacks one recording, the command to swim, a list of what to record.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from mjfish import fish as fishes
from mjfish.data import Dataset, columns, write_table
from mjfish.data.dataset_toml import FILE
from mjfish.data.validation import check_velocities
from mjfish.design.fitted_models import FittedModels, ModelEstimate, Question
from mjfish.design.information import Detection, Separation, detection, separations
from mjfish.design.menu import Menu, Run
from mjfish.diagnosis import Diagnosis, diagnose
from mjfish.diagnosis.evidence import DETECTED
from mjfish.drive import cpg as hopf
from mjfish.drive.cpg import DriveSegment
from mjfish.effects import Causes, Effect, catalogue, find, of_fish
from mjfish.effects.calibration import CALIBRATIONS, DOMAINS, Calibration
from mjfish.errors import InputError
from mjfish.execution import executing
from mjfish.execution.progress import Progress, part, silent
from mjfish.files import tomlfile
from mjfish.files.plain_data import unsaved
from mjfish.files.result import Result
from mjfish.files.writing import new_folder
from mjfish.fish import Cpg, fish_text, load_fish
from mjfish.fish.frames import CHANNELS
from mjfish.ode.rollout import STEP
from mjfish.parameters import Parameter

#: Below this probability of a verdict a run is not said to decide; above it the data are said to decide already.
_LIKELY = 0.5
#: Version of the layout of ``plan.json``.
SCHEMA = 2
#: How many options a summary lists.
_LISTED = 5
#: How many pairs of mechanisms, the hardest to tell apart, a run is asked for.
_HARDEST = 3


@dataclass(frozen=True)
class Pair:
    """What an option does for two rivals, or for one cause that is to be seen (`second` is empty then).

    Attributes:
        first, second: names.
        now, after: lambda, the misfit of the wrong one that no refit removes, in units of the noise; of a cause to be
            seen: the minimum detectable effect of its amplitude that is seen best.
        probability_now, probability_after: of the right verdict, with the data as they are and with the option.
        settled: measured directly by a calibration.
    """

    first: str
    second: str
    now: float
    after: float
    probability_now: float = math.nan
    probability_after: float = math.nan
    settled: bool = False


@dataclass(frozen=True)
class Isolated:
    """From which size on a rival, or a mechanism, is told from another one with 90 % power.

    Attributes:
        amplitude: full name of what has the size: of a rival at its fit its largest amplitude in units of scale, the
            others in proportion; of a mechanism its typical one (`mjfish.diagnosis.isolability`).
        beside: the rival or mechanism that it is told from.
        unit: of the sizes.
        now, after: the sizes, with the data as they are and with the option.
    """

    amplitude: str
    beside: str
    unit: str
    now: float
    after: float

    @property
    def gain(self) -> float:
        """Log of the size now over the size after."""
        return float(np.log(self.now / self.after))


@dataclass(frozen=True, eq=False)
class Option:
    """A run or calibration.

    Attributes:
        kind: ``calibration`` or ``run``.
        name: of it.
        about: what is done.
        seconds: of swimming, with the pause before it; 0 for a calibration.
        worth: the smallest gain of any pair a second: of lambda, or of -log of the minimum detectable effect; to the
            latter the smallest gain of -log of `isolability` is added.
        pairs: what it does for each pair, or cause.
        isolability: of a run, from which size on each rival is told from the one that is hardest to tell it from; of
            causes to be seen, the mechanisms that are hardest to tell from one another.
        drive: of a run by the CPG.
        run: behind it.
    """

    kind: Literal["calibration", "run"]
    name: str
    about: str
    seconds: float
    worth: float
    pairs: tuple[Pair, ...]
    drive: tuple[DriveSegment, ...] = ()
    run: Run | None = unsaved(default=None)
    isolability: tuple[Isolated, ...] = ()

    @property
    def worst(self) -> Pair:
        """The pair with the smallest probability of a verdict; of causes to be seen, the one that gains least."""
        return min(
            self.pairs,
            key=lambda p: (p.probability_after, p.after) if p.second else (0.0, -p.after / max(p.now, 1e-300)),
        )


@dataclass(frozen=True, eq=False, repr=False)
class Plan(Result):
    """What to do next.

    Attributes:
        dataset: name of the dataset.
        status: ``ok``, ``fit_not_converged``, or ``nothing_to_offer``.
        message: the advice in a few sentences.
        question: that is to be answered.
        options: calibrations that settle a pair first, then runs by worth.
        remarks: what a reader should know.
    """

    dataset: str
    status: Literal["ok", "fit_not_converged", "nothing_to_offer"]
    message: str
    question: Question
    options: tuple[Option, ...]
    remarks: tuple[str, ...] = ()

    @property
    def runs(self) -> tuple[Option, ...]:
        """The runs, best first."""
        return tuple(option for option in self.options if option.run is not None)

    @property
    def calibrations(self) -> tuple[Option, ...]:
        """The calibrations, those that settle most pairs first."""
        return tuple(option for option in self.options if option.kind == "calibration")

    def summary(self) -> str:
        """Return question, advice and the first options, a line each."""
        head = f"Plan for {self.dataset} ({self.status}): {self.question.why}"
        listed = ((option.name, option.worst) for option in self.options[:_LISTED])
        options = [
            f"  {name}: " + ("measured directly" if pair.settled else f"{pair.now:.3g} now, {pair.after:.3g} after")
            for name, pair in listed
        ]
        more = [f"  and {len(self.options) - _LISTED} more"] if len(self.options) > _LISTED else []
        return "\n".join([head, self.message, *options, *more])

    def to_dict(self) -> dict[str, Any]:
        """Return the plan as plain data, the content of ``plan.json``."""
        return {"schema": SCHEMA, **super().to_dict()}


def plan(
    diagnosis: Diagnosis | FittedModels | Dataset,
    *,
    rivals: Sequence[str] = (),
    causes: Sequence[str] = (),
    effects: Causes = None,
    menu: Menu | None = None,
    jobs: int | None = None,
    progress: Progress = silent,
) -> Plan:
    """Rank runs and calibrations by what they would do for a question that a diagnosis leaves open.

    Two rivals k and l are apart by lambda, the squared norm of the whitened difference of their predictions that a
    refit of l does not remove. A run of the menu adds its own rows to both models, linearised at their estimates, and
    lambda follows anew (`mjfish.design.information`); runs are ranked by the gain of lambda of the hardest pair a
    second. Along its fit, rival k is told from l from a share sqrt(18 / lambda) of its size on: the same ranking lowers
    its isolability. Where causes are to be made visible, runs are ranked by how far they shrink the minimum detectable
    effects, and the isolability of the mechanisms that are hardest to tell from one another.

    Models come from the diagnosis as it fitted them, to the fit trials; the held-out ones are added by one Gauss-Newton
    step. A rival is fitted here where the diagnosis did not fit it, or did not follow its refit to the optimum.

    Args:
        diagnosis: of `mjfish.diagnose`, or of its JSON by `mjfish.design.load_fitted_models`. A dataset is diagnosed
            first, or, where `rivals` or `causes` are given, only the models asked for are fitted, under white noise as
            the dataset states it, else as the best model leaves it.
        rivals: names of causes to tell apart, two or more; empty: what the diagnosis leaves open.
        causes: names of causes to make visible. With a diagnosis they are asked for where nothing is wrong.
        effects: causes by name, or Python files with causes of your own; None: those of
            the diagnosis, else the shipped ones.
        menu: of runs, and the pause before each; None: `Menu()`.
        jobs: threads; None: one a processor. The plan does not depend on it.
        progress: called with what is being done and the share that is done.

    Returns:
        The plan: calibrations that settle a pair first, then runs by worth.

    Raises:
        UnknownNameError: no such cause.
        InputError: fewer than two rivals, rivals and causes at once, or a cause that the dataset cannot show.

    Example:
        >>> import mjfish
        >>> pool = mjfish.generate(mjfish.load_fish("pike"), ["v1"], duration=2.0, noise=[0.02, 0.02, 0.1])
        >>> best = mjfish.plan(pool, rivals=["servo_lag", "time_offset"]).runs[0]
        >>> best.worst.after > best.worst.now
        True
    """
    if rivals and causes:
        raise InputError("rivals: found with causes, expected one of them; drop the other")
    dataset = diagnosis if isinstance(diagnosis, Dataset) else diagnosis.dataset
    dataset.split()  # refuses one without trials
    check_velocities(dataset, "a plan")
    with executing(jobs):
        if isinstance(diagnosis, Dataset) and not rivals and not causes:
            diagnosis = diagnose(diagnosis, effects=effects, progress=part(progress, 0.0, 0.5))
            progress = part(progress, 0.5, 0.5)
        known = _known(diagnosis, causes, effects)
        question = known.question
        if rivals:
            question = Question("separate", tuple(rivals), "Rivals named by hand.")
        elif question is None:
            question = Question("see", tuple(causes), "Causes named by hand.")
        return _planned(known, question, menu or Menu(), progress)


def _planned(known: FittedModels, question: Question, menu: Menu, progress: Progress) -> Plan:
    """Return the options for a question, ranked."""
    tried = _causes(known, question)
    question = replace(question, names=tuple(effect.name for effect in tried))
    runs, separate = menu.runs(known.dataset), question.purpose == "separate"
    models = known.estimates(tried if separate else (), progress)
    progress("trying the runs of the menu", 0.5)
    if separate:
        pairs = separations(models, runs)
        options = _ranked(_calibrations(tried, pairs)) + _ranked(_separating(pairs, _sizes(models), runs, menu.pause))
    else:
        options = _ranked(_revealing(detection(models[0], tried, runs), tried, runs, menu.pause))
    progress("done", 1.0)
    fitted: Literal["ok", "fit_not_converged"] = (
        "ok" if all(model.converged for model in models) else "fit_not_converged"
    )
    return Plan(
        dataset=known.dataset.name,
        status=fitted if options else "nothing_to_offer",
        message=_message(question, options),
        question=question,
        options=options,
        remarks=_remarks(known.dataset, options),
    )


def _known(
    diagnosis: Diagnosis | FittedModels | Dataset,
    causes: Sequence[str],
    effects: Causes,
) -> FittedModels:
    if isinstance(diagnosis, Dataset):
        return FittedModels.undiagnosed(diagnosis, catalogue(effects))
    known = FittedModels.of(diagnosis) if isinstance(diagnosis, Diagnosis) else diagnosis
    if effects is not None:
        known = replace(known, effects=catalogue(effects))
    if causes and known.question is not None and known.question.purpose == "see":
        known = replace(known, question=replace(known.question, names=tuple(causes)))
    return known


def _causes(known: FittedModels, question: Question) -> tuple[Effect, ...]:
    effects = of_fish(known.effects, known.dataset.fish)
    if not question.names:
        left = (effect for name, effect in effects.items() if name not in known.problem.nominal)
        return tuple(effect for effect in left if not effect.not_applicable(known.dataset))
    found = tuple(find(name, effects) for name in question.names)
    for effect in found:
        if reason := effect.not_applicable(known.dataset):
            raise InputError(f"{effect.name}: cannot be asked of this dataset: {reason}; leave it out")
    return found


def _ranked(options: Iterable[Option]) -> tuple[Option, ...]:
    return tuple(sorted(options, key=lambda option: -option.worth))


def _of_run(run: Run, pause: float, gain: float, pairs: tuple[Pair, ...], told: tuple[Isolated, ...]) -> Option:
    """Return a run as an option, worth its gain a second."""
    seconds = run.seconds + pause
    return Option("run", run.name, run.about, seconds, gain / seconds, pairs, run.trial.drive, run, told)


def _separating(
    pairs: Sequence[Separation], sizes: Mapping[str, tuple[Parameter, float]], runs: Sequence[Run], pause: float
) -> Iterator[Option]:
    """Yield the runs, worth the smallest gain of lambda of any pair a second."""
    for i, run in enumerate(runs):
        if all(pair.runs[i] is not None for pair in pairs):
            effects = tuple(_pair(pair, i) for pair in pairs)
            told = tuple(_hardest(rival, *size, pairs, i) for rival, size in sizes.items())
            yield _of_run(run, pause, min(pair.after - pair.now for pair in effects), effects, told)


def _sizes(models: Sequence[ModelEstimate]) -> dict[str, tuple[Parameter, float]]:
    """Return the amplitude of every rival that is largest in units of its scale, with its fitted size."""
    found = {}
    for model in models:
        values = model.problem.named(model.x)
        sizes = {p: abs(values[p.name] - p.default) for p in model.problem.model.effects[-1].amplitudes()}
        largest = max(sizes, key=lambda p: sizes[p] / p.scale)
        found[model.name] = largest, sizes[largest]
    return found


def _hardest(rival: str, p: Parameter, size: float, pairs: Sequence[Separation], run: int) -> Isolated:
    """Return the isolability of a rival, along its fit, from the one that is hardest to tell it from after a run."""

    def distinguishable_size(pair: Separation, run: int | None) -> float:
        return size * math.sqrt(DETECTED / max(pair.noncentrality_of(rival, run), 1e-300))

    pair = max((pair for pair in pairs if rival in pair.rivals), key=lambda pair: distinguishable_size(pair, run))
    (other,) = set(pair.rivals) - {rival}
    return Isolated(p.name, other, p.unit, distinguishable_size(pair, None), distinguishable_size(pair, run))


def _pair(pair: Separation, run: int | None) -> Pair:
    """Return what a run does for a pair; lambda of the truth for which it is smaller."""
    return Pair(*pair.rivals, pair.noncentrality(), pair.noncentrality(run), pair.probability(), pair.probability(run))


def _calibrations(rivals: Sequence[Effect], pairs: Sequence[Separation]) -> Iterator[Option]:
    """Yield the calibrations that settle a pair, the quickest first, worth as many as they settle."""
    for calibration in CALIBRATIONS:
        names = {effect.name for effect in rivals if calibration_of(effect) == calibration}
        done = tuple(
            replace(pair, after=np.inf, probability_after=1.0, settled=True)
            if names & {pair.first, pair.second}
            else pair
            for pair in (_pair(pair, None) for pair in pairs)
        )
        if settled := sum(pair.settled for pair in done):
            about = f"{calibration.about}: measures {', '.join(sorted(names))} directly"
            yield Option("calibration", calibration.name, about, 0.0, float(settled), done)


def calibration_of(effect: Effect) -> Calibration | None:
    """Return the calibration that measures a cause directly; None where only swimming shows it."""
    return effect.calibration or DOMAINS.get(effect.domain)


def _revealing(found: Detection, causes: Sequence[Effect], runs: Sequence[Run], pause: float) -> Iterator[Option]:
    """Yield the runs, worth what shrinks least, in -log: of the minimum detectable effects, and of the isolability."""
    formulas = [cause for cause in causes if not cause.learned] or causes  # a number of a curve is not seen alone
    now = {cause.name: found.sizes(cause.name) for cause in formulas}
    best = {
        cause: min(found.amplitudes[cause], key=lambda p: sizes[p.name] / p.scale).name
        for cause, sizes in now.items()
        if np.all(np.isfinite(list(sizes.values())))
    }
    apart = found.isolability(causes)
    for i in (i for i, added in enumerate(found.runs) if best and added is not None):
        pairs = tuple(Pair(p, "", now[cause][p], found.sizes(cause, i)[p]) for cause, p in best.items())
        after = found.isolability(causes, i, apart.amplitudes)
        told = tuple(
            Isolated(apart.amplitudes[k], apart.mechanisms[l], apart.units[k], apart.sizes[k][l], after.sizes[k][l])
            for k, l in apart.hardest(_HARDEST)  # noqa: E741 - the equation's
        )
        gain = min(float(np.log(pair.now / pair.after)) for pair in pairs)
        yield _of_run(runs[i], pause, gain + min((pair.gain for pair in told), default=0.0), pairs, told)


def _remarks(dataset: Dataset, options: Sequence[Option]) -> tuple[str, ...]:
    remarks = {
        "the fish has no CPG: the menu has repeats of its trials only; name a fish with [cpg] for more": (
            dataset.fish.cpg is None
        ),
        "repeats measure the noise; what they do here is in the table": (
            any(option.run is not None and option.run.repeat for option in options)
        ),
    }
    return tuple(remark for remark, applies in remarks.items() if applies)


def _message(question: Question, options: Sequence[Option]) -> str:
    """Say what to do first."""
    if not options:
        return "Nothing on the menu would help: the fish has no run that it can swim, or every cause is undetectable."
    calibrations = [option for option in options if option.kind == "calibration"]
    runs = [option for option in options if option.kind == "run"]
    first = [f"First {best.name}, which costs no swimming: {best.about}." for best in calibrations[:1]]
    return " ".join([*first, *(_advice(question, best, "Of the runs, " if calibrations else "") for best in runs[:1])])


def _advice(question: Question, best: Option, lead: str) -> str:
    what = f"{lead}{best.name} ({best.about})"
    what = what[0].upper() + what[1:]
    pair = best.worst
    if question.purpose == "see":
        what += f" shrinks the minimum detectable effect of every cause, at least to {pair.after / pair.now:.0%}."
        return " ".join([what, *map(_isolability_text, best.isolability)])
    if pair.probability_now > _LIKELY:
        return f"The data tell {pair.first} and {pair.second} apart already; {best.name} would do so most a second."
    advice = (
        f"{what} separates {pair.first} and {pair.second} most a second: probability of a verdict "
        f"{percent(pair.probability_now)} now, {percent(pair.probability_after)} after."
    )
    if pair.probability_after < _LIKELY:
        advice += " No single run of the menu is likely to decide; several may."
    return " ".join([advice, *map(_isolability_text, best.isolability)])


def _isolability_text(pair: Isolated) -> str:
    unit = "" if pair.unit == "-" else f" {pair.unit}"
    return (
        f"After it, {pair.amplitude} is told from {pair.beside} from {pair.after:.2g}{unit} on ({pair.now:.2g}{unit} "
        "now)."
    )


def percent(probability: float) -> str:
    """Return a probability as text, never as a certainty that it is not."""
    known = "> 99 %" if 0.995 <= probability < 1.0 else f"{100.0 * probability:.0f} %"
    return "" if math.isnan(probability) else known


#: Samples a second of the command.
_RATE = 100.0
_FISH = "fish.toml"
_LIST = "RECORD.md"


def write_next_run(dataset: Dataset, plan: Plan, folder: Path) -> Path:
    """Write what the best run of a plan needs, whole or not at all.

    ``dataset.toml`` names the recordings that are there, which are copied, and the one to come, `NAME.csv` beside it:
    once that is measured, the folder is the dataset to diagnose again. ``NAME.command.csv`` has the joint angles to be
    driven, ``RECORD.md`` says what to do and what to record.

    Args:
        dataset: that the plan is for; read from files.
        plan: with a run driven by a CPG.
        folder: absent or empty.

    Returns:
        The dataset.toml.

    Raises:
        InputError: there is no such run, the dataset was not read from files, or the folder cannot be written.
    """
    run = next((option.run for option in plan.runs if option.run is not None and option.drive), None)
    if run is None or dataset.fish.cpg is None:
        raise InputError(f"{dataset.name}: the plan has no run that a CPG drives, so there is no drive to write")
    if dataset.source is None:
        raise InputError(
            f"{dataset.name}: was not read from a dataset.toml, which the new one is made from; save it first"
        )
    raw = tomlfile.table(dataset.source)
    with new_folder(folder) as partial:
        if raw["fish"] not in fishes.shipped():
            own_fish = load_fish(raw["fish"], relative_to=dataset.source.parent)  # as its file has it, without [start]
            (partial / _FISH).write_text(fish_text(own_fish), encoding="utf-8")
            raw["fish"] = _FISH
        for name in _files(raw["trials"]):
            (partial / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(dataset.source.parent / name, partial / name)
        raw["trials"] = _trials(raw["trials"], dataset, run)
        (partial / FILE).write_text(tomlfile.text(raw), encoding="utf-8")
        (partial / _LIST).write_text("\n".join(_record_list(plan, run)) + "\n", encoding="utf-8")
        write_table(partial / f"{run.name}.command.csv", _command(dataset.fish.cpg, run))
    return folder.resolve() / FILE


def _files(entries: list[dict[str, Any]]) -> set[str]:
    """Return the names of all files of trials."""
    told = [*entries, *(sensor for entry in entries for sensor in entry.get("sensors", ()))]
    return {table[key] for table in told for key in ("file", "errors") if key in table}


def _trials(entries: list[dict[str, Any]], dataset: Dataset, run: Run) -> list[dict[str, Any]]:
    """Return old and new trials, every role written out: a trial more would else move the split."""
    _, held = dataset.split()
    for entry, trial in zip(entries, dataset.trials, strict=True):
        entry["role"] = "held_out" if trial in held else "fit"
    drive = [{"start": s.start, "omega": s.omega, "bias": list(s.bias)} for s in run.trial.drive]
    return [*entries, {"name": run.name, "file": f"{run.name}.csv", "role": "fit", "drive": drive}]


def _command(cpg: Cpg, run: Run) -> dict[str, Any]:
    end = float(run.trial.time[-1])
    time = np.arange(int(np.floor(end * _RATE + 1e-9)) + 1) / _RATE
    angle = hopf.joint_motion(cpg, run.trial.drive, end, STEP).angle_at(time)
    joints = {columns.header(columns.joint(j + 1)): angle[:, j] for j in range(angle.shape[1])}
    return {columns.header("time"): time, **joints}


def _record_list(plan: Plan, run: Run) -> Sequence[str]:
    calibrations = [f"- [ ] {option.name}: {option.about}" for option in plan.calibrations]
    segments = [(s.start, s.omega, ", ".join(f"{b:.3g}" for b in s.bias)) for s in run.trial.drive]
    return [
        f"# {run.name}",
        "",
        plan.question.why,
        plan.message,
        "",
        *(["## Before swimming", "", *calibrations, ""] if calibrations else []),
        "## Swim",
        "",
        "- [ ] Let the water come to rest; the fish lies still, straight, nose along +x.",
        *(f"- [ ] At {start:.3g} s: omega {omega:.4g} rad/s, bias {bias}." for start, omega, bias in segments),
        f"- [ ] Stop at {run.trial.time[-1]:.4g} s. The joint angles are in `{run.name}.command.csv`.",
        "",
        f"## Record, in `{run.name}.csv`",
        "",
        f"- [ ] Every {run.trial.step:.4g} s from 0 s on, the drive's start: columns "
        + ", ".join(f"`{columns.header(name)}`" for name in ("time", *CHANNELS))
        + ".",
        "- [ ] The same camera, markers and clock as in the runs before; of the nose, x forward, y to port, z up.",
        f"- [ ] If the camera tracks it: {', '.join(f'`{columns.header(name)}`' for name in columns.POSE)}.",
        "",
        "Then `mjfish diagnose` this folder.",
    ]
