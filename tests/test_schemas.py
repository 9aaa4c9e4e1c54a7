"""The JSON Schemas: what is written follows them, what is read is accepted and refused alike, the page is theirs."""

from __future__ import annotations

import copy
import json
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from diagnosed import diagnosis, learned_diagnosis
from doc_blocks import ROOT, blocks, run_python
from jsonschema import Draft202012Validator
from pydantic import BaseModel
from schema_check import complaints, schema

import mjfish
import schema_page
from mjfish.data import dataset_toml, save
from mjfish.data.dataset_toml import DatasetTable
from mjfish.diagnosis import Diagnosis
from mjfish.diagnosis.result import SCHEMA as DIAGNOSIS
from mjfish.diagnosis.result import Verdict
from mjfish.errors import InputError
from mjfish.estimation.identification import SCHEMA as IDENTIFICATION
from mjfish.estimation.settings import Settings
from mjfish.files.tomlfile import parse
from mjfish.fish import load_fish
from mjfish.inspection import Finding, Inspection
from mjfish.simulation.synthetic import generate
from mjfish.study import Study, cases, read_cases, run
from mjfish.study.pieces import SCHEMA as PIECE

NAMES = [file.stem for file in schema_page.files()]
#: Keys below these tables are names of the user's own.
FREE = ("start", "known", "columns", "effects", "servo_lag", "values")
EXAMPLE = tomllib.loads(blocks(ROOT / "docs" / "datasets.md", "toml")[0])
STUDY = tomllib.loads(blocks(ROOT / "docs" / "study.md", "toml")[0])
#: Files that are read, and what reads them.
READ: dict[str, tuple[dict[str, Any], type[BaseModel]]] = {
    "dataset-1": (EXAMPLE, DatasetTable),
    "study-1": (STUDY, Study),
}


@pytest.mark.parametrize("name", NAMES)
def test_a_schema_is_one_of_its_dialect_and_says_its_version(name: str) -> None:
    found = schema(name)
    Draft202012Validator.check_schema(found)
    kind, version = name.split("-")
    assert found["$id"] == f"urn:mjfish:schema:{kind}:{version}"
    assert found["properties"]["schema"]["const"] == int(version)


def test_there_is_a_schema_of_every_version_that_is_written() -> None:
    (dataset,), (study,) = (get_args(model.model_fields["schema_"].annotation) for _, model in READ.values())
    written = [f"diagnosis-{DIAGNOSIS}", f"identification-{IDENTIFICATION}", f"piece-{PIECE}"]
    assert [f"dataset-{dataset}", *written, f"study-{study}"] == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_every_key_is_described(name: str) -> None:
    found = schema(name)
    assert not [path for path, key in _keys(found, name) if not key.get("description") and "$ref" not in key]
    assert all(part["description"] for part in found["$defs"].values())


def _keys(part: Any, path: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield every key that a schema names, with its place."""
    if isinstance(part, dict):
        for name, below in part.get("properties", {}).items():
            if "const" not in below or below["const"] != "m/s":  # says what it is
                yield f"{path}.{name}", below
        for name, below in part.items():
            yield from _keys(below, f"{path}.{name}")
    elif isinstance(part, list):
        for below in part:
            yield from _keys(below, path)


def test_the_page_is_written_from_the_schemas() -> None:
    assert schema_page.PAGE.read_text(encoding="utf-8") == schema_page.page(), "run python tools/schema_page.py"


def test_the_python_of_the_page_runs(tmp_path: Path) -> None:
    (block,) = blocks(schema_page.PAGE, "python")
    assert run_python(block, tmp_path) == "urn:mjfish:schema:diagnosis:5\n"


@pytest.mark.parametrize("verdict", get_args(Verdict))
@pytest.mark.parametrize("held_out", [True, False])
def test_a_diagnosis_follows_its_schema(verdict: Verdict, held_out: bool) -> None:
    assert not complaints("diagnosis-5", diagnosis(verdict, held_out=held_out).to_dict())


def test_a_diagnosis_with_curves_and_findings_follows_its_schema() -> None:
    found: Diagnosis = learned_diagnosis()
    stuck = Finding("stuck", "suspect", "slow, surge, 1.2 s", "12 equal", "noise", "record it again")
    told = {**found.to_dict(), "checks": Inspection((stuck,)).to_dict()}
    assert told["mechanisms"][0]["curves"]
    assert not complaints("diagnosis-5", told)


def test_a_diagnosis_without_a_key_or_with_another_one_is_refused() -> None:
    told = diagnosis().to_dict()
    for slip, complaint in (
        ({key: value for key, value in told.items() if key != "verdict"}, "'verdict' is a required property"),
        ({**told, "verdikt": "named"}, "'verdikt' was unexpected"),
        ({**told, "verdict": "wrong"}, "'wrong' is not one of"),
        ({**told, "schema": 1}, "5 was expected"),
    ):
        (found,) = complaints("diagnosis-5", slip)
        assert complaint in found


def test_an_identification_follows_its_schema() -> None:
    """As the function returns it; the command line adds profiles."""
    sigma = np.array([0.01, 0.01, 0.05])
    pool = generate(load_fish("pike"), ["v1", "v3"], noise=sigma, duration=1.5, seed=3, held_out=["v3"], name="pool")
    settings = Settings(free=("c_d.*",), starts=1)
    told = mjfish.identify(pool, settings, jobs=1).to_dict()
    assert told["assessment"]["residual_tests"]["whiteness"]
    assert not complaints("identification-3", told)
    assert complaints("identification-3", {key: value for key, value in told.items() if key != "posterior"})
    assert complaints("identification-3", {**told, "status": "good"})


@pytest.mark.parametrize("file", sorted((ROOT / "mjfish").rglob("dataset.toml")), ids=lambda file: file.parent.name)
def test_a_shipped_dataset_follows_its_schema(file: Path) -> None:
    assert not complaints("dataset-1", tomllib.loads(file.read_text(encoding="utf-8")))


def test_a_written_dataset_follows_its_schema(tmp_path: Path) -> None:
    save(generate(load_fish("pike"), ["v1", "v5-v1"], duration=6.0, seed=1, name="pool"), tmp_path)
    assert not complaints("dataset-1", tomllib.loads((tmp_path / "dataset.toml").read_text(encoding="utf-8")))


@pytest.mark.parametrize("name", READ)
def test_the_example_of_a_page_is_accepted_by_schema_and_reader(name: str) -> None:
    example, model = READ[name]
    assert not complaints(name, example)
    parse(example, model, "example")


def test_a_piece_of_a_study_follows_its_schema(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Done and failed, of an identification and of a diagnosis that is made by hand."""
    text = 'schema = 1\n[[generate]]\nname = "a"\nmodes = ["v1"]\nduration = 2.0\n{}'
    quick = '[[identify]]\nname = "quick"\nfree = ["c_d.*"]\nstarts = 1\n'
    other = '[[diagnose]]\nname = "cause"\n[[identify]]\nname = "wrong"\nfree = ["d.*"]\n'
    (tmp_path / "study.toml").write_text(text.format(quick + other))
    monkeypatch.setattr(cases, "diagnose", lambda *_, **__: diagnosis())
    pieces = read_cases(tmp_path / "study.toml")
    assert run(pieces, tmp_path).failed == 1
    found = [json.loads((tmp_path / "pieces" / f"{piece.key}.json").read_text()) for piece in pieces]
    assert [one["outcome"] for one in found] == ["done", "failed", "done"]
    assert {"verdict", "status"} <= {*found[2]["result"], *found[0]["result"]}
    for one in found:
        assert not complaints("piece-1", one)
        assert complaints("piece-1", {key: value for key, value in one.items() if key not in ("result", "reason")})


def _places(part: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """Yield the place of every key whose name is ours."""
    if isinstance(part, dict):
        for key, below in part.items():
            if not path or path[-1] not in FREE:
                yield (*path, key)
            yield from _places(below, (*path, key))
    elif isinstance(part, list):
        for index, below in enumerate(part):
            yield from _places(below, (*path, index))


@pytest.mark.parametrize(
    ("name", "place"),
    [(name, place) for name, (example, _) in READ.items() for place in _places(example)],
    ids=lambda value: value if isinstance(value, str) else ".".join(map(str, value)),
)
def test_a_misspelt_key_is_refused_by_schema_and_reader(name: str, place: tuple[str | int, ...]) -> None:
    example, model = READ[name]
    slip = copy.deepcopy(example)
    owner: Any = slip
    for step in place[:-1]:
        owner = owner[step]
    owner[f"{place[-1]}x"] = owner.pop(place[-1])
    assert complaints(name, slip)
    with pytest.raises(InputError):
        parse(slip, model, "example")


@pytest.mark.parametrize(
    "slip",
    [{"schema": 2}, {"name": ""}, {"clock": "loose"}, {"noise": {"surge": 0.0}}, {"trials": []}, {"fish": 3}],
    ids=json.dumps,
)
def test_a_wrong_value_of_a_dataset_is_refused_by_schema_and_reader(slip: dict[str, Any]) -> None:
    assert complaints("dataset-1", {**EXAMPLE, **slip})
    with pytest.raises(InputError):
        parse({**EXAMPLE, **slip}, DatasetTable, "example")


@pytest.mark.parametrize(
    "slip",
    [
        {"schema": 2},
        {"seeds": []},
        {"seeds": [-1]},
        {"generate": [{"name": "a"}]},
        {"identify": [{"name": "a", "starts": 0}]},
    ],
    ids=json.dumps,
)
def test_a_wrong_value_of_a_study_is_refused_by_schema_and_reader(slip: dict[str, Any]) -> None:
    assert complaints("study-1", {**STUDY, **slip})
    with pytest.raises(InputError):
        parse({**STUDY, **slip}, Study, "example")


def test_the_schemas_have_the_keys_that_are_read() -> None:
    study = schema("study-1")
    found = schema("dataset-1")
    keys, defs = found["properties"], found["$defs"]
    gaussian, differentiated = keys["filter"]["oneOf"]
    segments, wave = defs["trial"]["properties"]["drive"]["anyOf"]
    read: dict[type[BaseModel], dict[str, Any]] = {
        DatasetTable: found,
        dataset_toml.Noise: keys["noise"],
        dataset_toml.TankTable: keys["tank"],
        dataset_toml.Bounds: defs["start"]["anyOf"][1],
        dataset_toml.ParameterPrior: keys["known"]["additionalProperties"],
        dataset_toml.GaussianTable: gaussian,
        dataset_toml.DifferentiatedTable: differentiated,
        dataset_toml.TrialTable: defs["trial"],
        dataset_toml.Drive: segments["items"],
        dataset_toml.WaveDrive: wave,
        dataset_toml.SensorTable: defs["sensor"],
        dataset_toml.PlaceTable: defs["sensor"]["properties"]["place"],
        Study: study,
        cases.Generated: study["$defs"]["generate"],
        cases.Folder: study["$defs"]["folder"],
        cases.Identify: study["$defs"]["identify"],
        cases.Diagnose: study["$defs"]["diagnose"],
    }
    for model, part in read.items():
        fields = {field.alias or name: field for name, field in model.model_fields.items() if name != "wave"}
        assert set(part["properties"]) == set(fields), model
        assert set(part["required"]) == {name for name, field in fields.items() if field.is_required()}, model
