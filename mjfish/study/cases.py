"""The tables of a study, and its pieces: every dataset meets every setting with every seed."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from mjfish.data import load_dataset
from mjfish.data.dataset_toml import FILE, Number, Positive
from mjfish.data.tables import write_rows
from mjfish.diagnosis import diagnose
from mjfish.drive.modes import DURATION, MODES
from mjfish.effects import Effect, catalogue, find, of_fish
from mjfish.errors import InputError, located
from mjfish.estimation import Settings, identify
from mjfish.estimation.settings import Loss, Weights
from mjfish.files import tomlfile
from mjfish.files.tomlfile import Table
from mjfish.files.writing import exists, write_text
from mjfish.fish import Fish, load_fish
from mjfish.model import Model
from mjfish.simulation import generate
from mjfish.study.pieces import Piece, Store

Seed = Annotated[int, Field(ge=0)]


class Named(Table):
    """An entry with a name, by which tables and summaries call it."""

    name: Annotated[str, Field(min_length=1)]


class Generated(Named):
    """One entry of ``[[generate]]``, see `mjfish.generate`: noise in m/s, m/s and rad/s, rate in Hz, duration in s."""

    fish: str = "pike"
    modes: Annotated[tuple[Literal[tuple(MODES)], ...], Field(min_length=1)]  # type: ignore[valid-type]
    effects: Annotated[dict[str, dict[str, Number]], Field(default_factory=dict)]
    values: Annotated[dict[str, Number], Field(default_factory=dict)]
    noise: Annotated[tuple[Number, ...], Field(min_length=3, max_length=3)] = (0.01, 0.01, 0.05)
    rate: Positive = 50.0
    duration: Positive = DURATION
    held_out: tuple[str, ...] = ()


class Folder(Named):
    """One entry of ``[[folder]]``: a dataset's folder, from that of the study's file."""

    path: Annotated[str, Field(min_length=1)]


class Identify(Named):
    """One entry of ``[[identify]]``, see `mjfish.estimation.Settings`."""

    free: tuple[str, ...] = ("*",)
    loss: Loss = "linear"
    weights: Weights = "noise"
    starts: Annotated[int, Field(ge=1)] = 16


class Diagnose(Named):
    """One entry of ``[[diagnose]]``."""


class Study(Table):
    """A study.

    Attributes:
        schema_: version of this file.
        seeds: of the noise of generated datasets, of the starts of an identification, and of a diagnosis.
        generate, folder: the datasets.
        identify, diagnose: what is done with each.
    """

    schema_: Annotated[Literal[1], Field(alias="schema")]
    seeds: Annotated[tuple[Seed, ...], Field(min_length=1)] = (0,)
    generate: tuple[Generated, ...] = ()
    folder: tuple[Folder, ...] = ()
    identify: tuple[Identify, ...] = ()
    diagnose: tuple[Diagnose, ...] = ()


def read_study(path: Path) -> Study:
    """Read a study.

    Raises:
        InputError: the file is absent or breaks the schema; it lacks datasets or settings; a name is taken twice; a
            folder holds no dataset.
        UnknownNameError: an effect, one of its parameters, or a fish is unknown.
    """
    study = tomlfile.read(path, Study)
    with located(str(path)):
        _check_names("dataset", "[[generate]] or [[folder]]", (*study.generate, *study.folder))
        _check_names("setting", "[[identify]] or [[diagnose]]", (*study.identify, *study.diagnose))
        if len(set(study.seeds)) < len(study.seeds):
            raise InputError("seeds: one is given twice; give each once")
        for generated in study.generate:
            with located(f"generate {generated.name}"):
                acting(generated, path.parent)
        for folder in study.folder:
            if not exists(path.parent / folder.path / FILE):
                raise InputError(f"folder {folder.name}: {path.parent / folder.path} holds no {FILE}; correct the path")
        for identify in study.identify:
            with located(f"identify {identify.name}"):
                Settings(**identify.model_dump(exclude={"name"}))
    return study


def _check_names(what: str, where: str, entries: Sequence[Named]) -> None:
    names = [entry.name for entry in entries]
    if not names:
        raise InputError(f"there is no {what}; add one by {where}")
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"two {what}s are named '{name}'; rename one")


def acting(generated: Generated, home: Path) -> tuple[Fish, list[Effect], dict[str, float]]:
    """Return the fish of a generated dataset, the effects that act, and all values that are given, by full name.

    The path of a fish starts at `home`.
    """
    fish = load_fish(generated.fish, home)
    known = of_fish(catalogue(), fish)
    for name in generated.values:
        if name.partition(".")[0] in known:
            raise InputError(f"values: {name} is of an effect; write it in the table effects")
    effects: list[Effect] = []
    values = dict(generated.values)
    for name, own in generated.effects.items():
        effect = find(name, known)
        if not own:
            raise InputError(f"effect {name}: has no value; give one of its parameters a value")
        effects.append(effect)
        values.update({effect.declaration(short).name: value for short, value in own.items()})
    return fish, effects, values


#: What a piece keeps of an identification and of a diagnosis.
_OF_IDENTIFICATION = ("status", "message", "evaluations", "cost", "reached", "parameters", "scores", "remarks")
_OF_DIAGNOSIS = ("verdict", "message", "status", "p_wrong", "causes", "rivals", "alternatives", "gain", "remarks")


@dataclass(frozen=True)
class Case(Piece):
    """One dataset under one setting with one seed.

    Attributes:
        dataset: generated, or a folder.
        setting: what is done with it.
        seed: of all that is random.
        home: folder of the study's file, where paths start.
    """

    dataset: Generated | Folder
    setting: Identify | Diagnose
    seed: int
    home: Path

    @property
    def name(self) -> str:
        """Dataset, setting and seed."""
        return f"{self.dataset.name}, {self.setting.name}, seed {self.seed}"

    @cached_property
    def input(self) -> dict[str, Any]:
        """All that the outcome hangs on, as plain data: contents in place of names and paths."""
        if isinstance(self.dataset, Generated):
            own = self.dataset.model_dump(mode="json", exclude={"name"})
            fish = load_fish(self.dataset.fish, self.home).model_dump(mode="json", by_alias=True)
            made = {"generate": {**own, "fish": fish}}
        else:
            made = {"folder": _contents(self.home / self.dataset.path)}
        verb = "identify" if isinstance(self.setting, Identify) else "diagnose"
        setting = {verb: self.setting.model_dump(mode="json", exclude={"name"})}
        return {**made, **setting, "seed": self.seed, "version": version("mjfish")}

    def result(self) -> dict[str, Any]:
        """Return what is found, as plain data."""
        if isinstance(self.dataset, Folder):
            dataset = load_dataset(self.home / self.dataset.path)
        else:
            fish, effects, values = acting(self.dataset, self.home)
            given = self.dataset.model_dump(include={"modes", "noise", "held_out", "rate", "duration"})
            dataset = generate(fish, values=values, effects=effects, seed=self.seed, **given)
        if isinstance(self.setting, Identify):
            settings = Settings(**self.setting.model_dump(exclude={"name"}), seed=self.seed)
            found = identify(dataset, settings, jobs=1).to_dict()
            return {name: found[name] for name in _OF_IDENTIFICATION}
        found = diagnose(dataset, seed=self.seed, jobs=1).to_dict()
        mechanisms = [{name: one[name] for name in ("name", "level", "form")} for one in found["mechanisms"]]
        kept = {name: found[name] for name in _OF_DIAGNOSIS}
        return {**kept, "mechanisms": mechanisms, "parameters": found["coefficients"]["extended"]}

    def truth(self) -> dict[str, float]:
        """Return the values with which a dataset was generated, by full name; none of one that was not."""
        if isinstance(self.dataset, Folder):
            return {}
        fish, effects, values = acting(self.dataset, self.home)
        return Model(fish, tuple(effects)).values(values)


def read_cases(file: Path) -> list[Case]:
    """Return the pieces of a study, seeds within settings within datasets.

    Args:
        file: of the study; its paths start at its folder.

    Raises:
        InputError, UnknownNameError: as of `read_study`.
    """
    study, home = read_study(file), file.resolve().parent
    datasets: tuple[Generated | Folder, ...] = (*study.generate, *study.folder)
    settings: tuple[Identify | Diagnose, ...] = (*study.identify, *study.diagnose)
    return [Case(dataset, setting, seed, home) for dataset in datasets for setting in settings for seed in study.seeds]


def _contents(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of every file of a dataset by its path in the folder, and of its fish if that is elsewhere."""
    files = {path.relative_to(folder).as_posix(): path for path in sorted(folder.rglob("*")) if path.is_file()}
    fish = tomlfile.table(folder / FILE).get("fish")
    if isinstance(fish, str) and exists(folder / fish):
        files[fish] = folder / fish
    try:
        return {name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in files.items()}
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be read: {error.strerror}; make it readable") from None


#: Files of a collection.
TABLE, SUMMARY = "study.csv", "summary.txt"


@dataclass(frozen=True)
class Collected:
    """What was collected.

    Attributes:
        rows: of the table, a piece each.
        summary: a line a dataset and setting.
        missing: pieces that are not done, or whose file is damaged.
        files: that were written.
    """

    rows: tuple[dict[str, Any], ...]
    summary: str
    missing: int
    files: tuple[Path, ...]


def collect(cases: Sequence[Case], out: Path) -> Collected:
    """Write a CSV table, a row a piece, and a summary of the pieces of a study that are done in a folder.

    Args:
        cases: all pieces of the study.
        out: their folder.

    Raises:
        InputError: none of them is done; the folder cannot be written.
    """
    store = Store(out)
    rows: list[dict[str, Any]] = []
    for case in cases:
        try:
            content = store.read(case.key)
        except InputError:
            content = None
        if content is not None:
            rows.append(_row(case, content, store.seconds(case.key)))
    if not rows:
        raise InputError(f"{out}: holds no piece of this study that is done; run the study into this folder first")
    names = dict.fromkeys(name for row in rows for name in row)
    text = "\n".join(_summary(cases, rows)) + "\n"
    write_rows(out / TABLE, [{name: row.get(name) for name in names} for row in rows])
    write_text(out / SUMMARY, text)
    return Collected(tuple(rows), text, len(cases) - len(rows), (out / TABLE, out / SUMMARY))


def _row(case: Case, content: dict[str, Any], seconds: float | None) -> dict[str, Any]:
    """Return the row of a piece: what was done, what came of it, and the estimates."""
    result = content.get("result", {})
    generated = case.dataset if isinstance(case.dataset, Generated) else None
    row = {
        "dataset": case.dataset.name,
        "setting": case.setting.name,
        "seed": case.seed,
        "outcome": result.get("verdict", result.get("status", content["outcome"])),
        "reason": content.get("reason", result.get("message")),
        "causes": ", ".join(cause["name"] for cause in result.get("causes", ())),
        "true_causes": None if generated is None else ", ".join(generated.effects),
        "right": _right(result, generated) if generated is not None and "verdict" in result else None,
        "seconds": seconds,
        "piece": case.key,
    }
    estimates = result.get("parameters", {})
    truth = case.truth() if estimates else {}
    for name, value in estimates.items():
        row.update({name: value["estimate"], f"{name} low": value["low"], f"{name} high": value["high"]})
        if name in truth:
            row[f"{name} true"] = truth[name]
    return row


def _right(result: dict[str, Any], generated: Generated) -> str:
    """Return ``yes``, ``no``, or ``open`` where the mechanisms that act are among those that cannot be told apart."""
    truth = _mechanisms(generated.effects)
    if result["verdict"] == "cannot_tell":
        return "open" if truth in map(_mechanisms, result["alternatives"]) else "no"
    named = {one["name"] for one in result["mechanisms"]}
    return "yes" if result["verdict"] != "unexplained" and named == truth else "no"


def _mechanisms(causes: Iterable[str]) -> set[str]:
    known = catalogue()
    return {known[name].mechanism if name in known else name for name in causes}


def _summary(cases: Sequence[Case], rows: Sequence[dict[str, Any]]) -> list[str]:
    """Return a line for all, then one for each dataset and setting."""
    failed = sum(row["outcome"] == "failed" for row in rows)
    lines = [f"{len(rows)} of {len(cases)} pieces are done, {failed} of them failed."]
    for dataset, setting in dict.fromkeys((case.dataset.name, case.setting.name) for case in cases):
        own = [row for row in rows if (row["dataset"], row["setting"]) == (dataset, setting)]
        outcomes = Counter(str(row["outcome"]) for row in own)
        right = Counter(row["right"] for row in own if row["right"] is not None)
        said = [f"{count} {name}" for name, count in outcomes.most_common()] or ["none done"]
        said += [f"right: {right['yes']} yes, {right['no']} no, {right['open']} open"] if right else []
        known = [row["seconds"] for row in own if row["seconds"] is not None]
        said += [f"{sum(known) / len(known):.1f} s a piece"] if known else []
        lines.append(f"{dataset}, {setting}: {'; '.join(said)}")
    return lines
