"""The pieces of a study: one dataset under one setting with one seed."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any

from mjfish.data import Dataset, load_dataset
from mjfish.data.dataset_toml import FILE
from mjfish.diagnosis import diagnose
from mjfish.errors import InputError
from mjfish.estimation import Settings, identify
from mjfish.files import tomlfile
from mjfish.files.writing import exists
from mjfish.model import Model
from mjfish.simulation import generate
from mjfish.study.pieces import Piece
from mjfish.study.study_toml import Diagnose, Folder, Generated, Identify, acting, fish_of, read_study

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
        dataset = self.dataset
        if isinstance(dataset, Generated):
            own = dataset.model_dump(mode="json", exclude={"name"})
            made = {"generate": {**own, "fish": fish_of(dataset, self.home).model_dump(mode="json", by_alias=True)}}
        else:
            made = {"folder": _contents(self.home / dataset.path)}
        verb = "identify" if isinstance(self.setting, Identify) else "diagnose"
        setting = {verb: self.setting.model_dump(mode="json", exclude={"name"})}
        return {**made, **setting, "seed": self.seed, "version": version("mjfish")}

    def result(self) -> dict[str, Any]:
        """Return what is found, as plain data."""
        dataset = self._load()
        if isinstance(self.setting, Identify):
            asked = self.setting
            settings = Settings(
                free=asked.free, loss=asked.loss, weights=asked.weights, starts=asked.starts, seed=self.seed
            )
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
        fish = fish_of(self.dataset, self.home)
        effects, values = acting(self.dataset, fish)
        return Model(fish, tuple(effects)).values(values)

    def _load(self) -> Dataset:
        if isinstance(self.dataset, Folder):
            return load_dataset(self.home / self.dataset.path)
        made, fish = self.dataset, fish_of(self.dataset, self.home)
        effects, values = acting(made, fish)
        return generate(
            fish,
            made.modes,
            values=values,
            effects=effects,
            noise=made.noise,
            seed=self.seed,
            held_out=made.held_out,
            rate=made.rate,
            duration=made.duration,
        )


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
    files = {str(path.relative_to(folder).as_posix()): path for path in sorted(folder.rglob("*")) if path.is_file()}
    fish = tomlfile.table(folder / FILE).get("fish")
    if isinstance(fish, str) and exists(folder / fish):
        files[fish] = folder / fish
    try:
        return {name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in files.items()}
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be read: {error.strerror}; make it readable") from None
