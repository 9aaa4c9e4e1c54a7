"""A study finishes what is missing, and nothing else; what is wrong with it is said."""

from __future__ import annotations

import csv
import errno
import json
import os
import shutil
import tempfile
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import pytest
from schema_check import complaints
from small_study import SMALL, contents, write_study
from typer.testing import CliRunner

import mjfish
from mjfish.cli import application
from mjfish.data import save
from mjfish.errors import InputError, MjfishError
from mjfish.study import Case, Shard, collect, read_cases, read_study, run
from mjfish.study.pieces import locked

DIAGNOSE = SMALL.partition("[[identify]]")[0] + '[[diagnose]]\nname = "cause"\n'


def _fill(out: Path, made: dict[str, bytes]) -> None:
    (out / "pieces").mkdir(parents=True)
    for name, raw in made.items():
        (out / "pieces" / name).write_bytes(raw)


def test_only_missing_pieces_are_made_and_have_the_same_bytes(tmp_path: Path, made: dict[str, bytes]) -> None:
    out = tmp_path / "out"
    _fill(out, made)
    (out / "pieces" / min(made)).unlink()
    ran = run(read_cases(write_study(tmp_path)), out)
    assert (ran.there, ran.made, ran.damaged) == (3, 1, ())
    assert contents(out) == made
    assert not list(out.glob("*.lock"))


def test_damaged_pieces_are_made_anew_and_said(tmp_path: Path, made: dict[str, bytes]) -> None:
    """One that is cut off, and one in which a digit is another."""
    out = tmp_path / "out"
    _fill(out, made)
    first, second, third, _ = sorted(made)
    (out / "pieces" / first).write_bytes(made[first][:-200])
    (out / "pieces" / second).write_bytes(made[second].replace(b'"estimate": ', b'"estimate": 1', 1))
    (out / "pieces" / third).write_bytes(made[first])
    ran = run(read_cases(write_study(tmp_path)), out)
    assert (ran.there, ran.made) == (1, 3)
    assert all(any(name in said for said in ran.damaged) for name in (first, second, third))
    assert contents(out) == made


def test_two_shares_make_the_whole(tmp_path: Path, made: dict[str, bytes]) -> None:
    cases = read_cases(write_study(tmp_path))
    assert run(cases, tmp_path / "out", shard=Shard(1, 2)).made == 2
    assert run(cases, tmp_path / "out", shard=Shard(2, 2)).made == 2
    assert contents(tmp_path / "out") == made


def test_a_piece_that_fails_is_stored_with_its_reason_and_the_rest_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever the error is, one of the user or of the program."""

    def result(piece: Case) -> dict[str, Any]:
        if piece.seed == 1:
            raise ZeroDivisionError("by nothing") if piece.dataset.name == "lag" else SystemExit(3)
        return {"status": "converged", "parameters": {}}

    monkeypatch.setattr(Case, "result", result)
    cases, out = read_cases(write_study(tmp_path)), tmp_path / "out"
    assert run(cases, out).failed == 2
    ran = run(cases, out)
    assert (ran.there, ran.made, ran.failed) == (4, 0, 2)
    assert "ZeroDivisionError: by nothing" in "".join(raw.decode() for raw in contents(out).values())
    assert "4 of 4 pieces are done, 2 of them failed" in collect(cases, out).summary


def test_what_is_wrong_with_a_dataset_fails_its_piece(tmp_path: Path) -> None:
    text = SMALL.replace("seeds = [1, 2]", "").replace("effects = {", 'values = { "c_d.nose" = 1.0 }\neffects = {')
    ran = run(read_cases(write_study(tmp_path, text)), tmp_path / "out")
    assert (ran.made, ran.failed) == (2, 1)


def test_two_runs_into_one_folder_are_refused(tmp_path: Path) -> None:
    """Also where they share some pieces only; shares without a common piece run side by side."""
    with locked(tmp_path, Shard(1, 2)):
        for other in (Shard(1, 2), Shard(), Shard(3, 4)):
            with pytest.raises(InputError, match="another run is at work"), locked(tmp_path, other):
                pass
        with locked(tmp_path, Shard(2, 2)):
            pass
    with locked(tmp_path, Shard()):
        pass


def test_the_lock_of_a_process_that_ended_is_taken_over(tmp_path: Path) -> None:
    """Whatever the file says: the system knows who holds it."""
    (tmp_path / "run-1-of-1.lock").write_text("left behind")
    for shard in (Shard(1, 2), Shard()):
        with locked(tmp_path, shard):
            pass


def test_a_folder_that_cannot_be_written_is_a_named_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be made"):
        run(read_cases(write_study(tmp_path)), tmp_path / "file" / "out")


def test_a_full_disk_is_a_named_error_and_the_same_command_goes_on(tmp_path: Path, made: dict[str, bytes]) -> None:
    """The system refuses files of more than 1000 bytes in place of a full disk."""
    resource = pytest.importorskip("resource", reason="the limit of a file's size is that of POSIX")
    cases, out = read_cases(write_study(tmp_path)), tmp_path / "out"
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        with pytest.raises(InputError, match="cannot be written: File too large"):
            run(cases, out)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert contents(out) == {}
    assert not list(out.glob("*.lock"))
    assert run(cases, out).made == 4
    assert contents(out) == made


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EACCES, errno.EROFS], ids=errno.errorcode.get)
def test_a_disk_that_takes_no_more_is_a_named_error_and_what_is_done_is_kept(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, made: dict[str, bytes]
) -> None:
    """From the fourth file on, after the lock and a piece with its time."""
    cases, out, files = read_cases(write_study(tmp_path)), tmp_path / "out", []

    def refused(*arguments: Any, **options: Any) -> str:
        files.append(options)
        if len(files) > 3:
            raise OSError(number, os.strerror(number))
        return mkdtemp(*arguments, **options)

    with monkeypatch.context() as patch:
        patch.setattr(tempfile, "mkdtemp", refused)
        with pytest.raises(InputError, match=f"cannot be written: {os.strerror(number)}; choose a folder"):
            run(cases, out)
    assert len(contents(out)) == 1
    assert contents(out).items() <= made.items()
    assert {path.name for path in out.iterdir()} == {"pieces", "seconds"}
    assert run(cases, out).made == 3
    assert contents(out) == made


def test_the_hash_hangs_on_contents_and_not_on_names(tmp_path: Path) -> None:
    """A dataset that changes is computed again, one that is renamed is not."""
    save(mjfish.generate("pike", ["v1"], duration=2.0), tmp_path / "pool")
    text = 'schema = 1\n[[folder]]\nname = "mine"\npath = "pool"\n[[identify]]\nname = "quick"\n'

    def key(text: str) -> str:
        (piece,) = read_cases(write_study(tmp_path, text))
        return piece.key

    first = key(text)
    shutil.copytree(tmp_path / "pool", tmp_path / "copy")
    assert key(text.replace("mine", "yours").replace("pool", "copy")) == first
    assert key(text + "starts = 2\n") != first
    table = next((tmp_path / "pool").glob("*.csv"))
    table.write_text(table.read_text().replace("1", "2", 1))
    assert key(text) != first


FOUND = {
    "lag": {"verdict": "cannot_tell", "alternatives": [["time_offset"], ["servo_lag"]], "mechanisms": []},
    "plain": {"verdict": "nothing_wrong", "alternatives": [], "mechanisms": []},
}


def test_the_table_says_what_came_of_each_piece_and_whether_it_is_right(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def result(piece: Case) -> dict[str, Any]:
        estimate = {"servo_lag.time_constant": {"estimate": 0.031, "low": 0.02, "high": 0.04, "unit": "s"}}
        named = {"verdict": "named", "causes": [{"name": "servo_lag"}], "mechanisms": [{"name": "servo_dynamics"}]}
        return {**named, "parameters": estimate} if piece.seed == 1 else FOUND[piece.dataset.name]

    monkeypatch.setattr(Case, "result", result)
    cases, out = read_cases(write_study(tmp_path, DIAGNOSE)), tmp_path / "out"
    run(cases, out)
    collected = collect(cases, out)
    with (out / "study.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [(row["dataset"], row["seed"], row["outcome"], row["true_causes"], row["right"]) for row in rows] == [
        ("lag", "1", "named", "servo_lag", "yes"),
        ("lag", "2", "cannot_tell", "servo_lag", "open"),
        ("plain", "1", "named", "", "no"),
        ("plain", "2", "nothing_wrong", "", "yes"),
    ]
    assert rows[0]["causes"] == "servo_lag"
    assert float(rows[0]["servo_lag.time_constant"]) == 0.031
    assert all(float(row["seconds"]) >= 0.0 for row in rows)
    assert "lag, cause: 1 named; 1 cannot_tell; right: 1 yes, 0 no, 1 open" in collected.summary
    assert (out / "summary.txt").read_text() == collected.summary


@pytest.mark.slow
def test_a_real_diagnosis_is_a_piece_with_its_row(tmp_path: Path) -> None:
    text = """
    schema = 1
    seeds = [5]
    [[generate]]
    name = "lag"
    modes = ["v1", "v3", "v5", "v1-v5", "v5-v1", "v3-t2"]
    noise = [0.006, 0.006, 0.05]
    held_out = ["v3", "v5-v1"]
    effects = { servo_lag = { time_constant = 0.03 } }
    [[diagnose]]
    name = "cause"
    """
    cases, out = read_cases(write_study(tmp_path, text)), tmp_path / "out"
    assert run(cases, out).failed == 0
    (piece,) = contents(out).values()
    assert not complaints("piece-1", json.loads(piece))
    collected = collect(cases, out)
    (row,) = collected.rows
    assert (row["outcome"], row["causes"], row["true_causes"], row["right"]) == (
        "named",
        "servo_lag",
        "servo_lag",
        "yes",
    )
    lag = "servo_lag.time_constant"
    assert row[f"{lag} true"] == 0.03
    assert row[f"{lag} low"] < row[lag] < row[f"{lag} high"]
    assert row[lag] == pytest.approx(0.03, rel=0.05)
    assert "lag, cause: 1 named; right: 1 yes, 0 no, 0 open" in collected.summary


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("servo_lag", "servo_lug", "unknown effect 'servo_lug'"),
        ("time_constant", "constant", "unknown parameter of servo_lag 'constant'"),
        ('"v1"', '"v2"', "generate.1.modes.1"),
        ('name = "plain"', 'name = "lag"', "two datasets are named 'lag'"),
        ("[1, 2]", "[1, 1]", "seeds"),
        ("[[identify]]", "[[folder]]", "unknown key"),
        ("starts = 1", "starts = 0", "must be at least 1"),
        ("duration = 2.0", 'fish = "carp"', "unknown fish 'carp'"),
        ("duration = 2.0", 'values = { "munk_moment.kappa" = 1 }', "write it in the table effects"),
        (SMALL, 'schema = 1\n[[identify]]\nname = "quick"', "there is no dataset"),
        (SMALL, 'schema = 1\n[[folder]]\nname = "a"\npath = "b"\n[[identify]]\nname = "c"', "holds no dataset.toml"),
    ],
)
def test_what_is_wrong_with_a_study_is_said_with_its_place(tmp_path: Path, old: str, new: str, said: str) -> None:
    assert old in SMALL
    file = write_study(tmp_path, SMALL.replace(old, new))
    with pytest.raises(MjfishError) as caught:
        read_study(file)
    assert said in str(caught.value)
    assert str(file) in str(caught.value)


def test_a_share_that_there_is_not_is_refused(tmp_path: Path) -> None:
    file = write_study(tmp_path)
    for text in ("3/2", "0/2", "one"):
        done = CliRunner().invoke(application(), ["study", str(file), "--out", str(tmp_path / "out"), "--shard", text])
        assert done.exit_code == 2
        assert "expected I/N" in done.output
