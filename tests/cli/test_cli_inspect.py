"""``mjfish inspect``: what is in a dataset, what blocks a diagnosis, what its runs cannot show."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from command_line import Run

import mjfish
from mjfish.data import save
from mjfish.numerics.arrays import readonly


@pytest.fixture
def pool(tmp_path: Path) -> Path:
    """Two good runs; nothing of places is known."""
    save(mjfish.generate("pike", ["v1", "v3"], noise=(0.01, 0.01, 0.05), held_out=["v3"]), tmp_path / "pool")
    return tmp_path / "pool"


@pytest.mark.usefixtures("pool")
def test_runs_and_what_they_cannot_show_are_listed_and_nothing_blocks(run: Run) -> None:
    shown = run("inspect pool").stdout
    assert re.search(r"v1 +fit +10\.4 +50 .* the CPG", shown)
    assert re.search(r"v3 +held out +10\.4 +50 ", shown)
    assert re.search(r"cannot show  wall_effect: the walls are not known", shown)
    assert re.search(r"cannot tell  .*design-no-turn", shown)
    assert "nothing blocks a diagnosis; next: " in shown
    assert all(len(line) <= 200 for line in shown.splitlines())


@pytest.mark.usefixtures("pool")
def test_json_on_standard_output_is_json_alone_and_a_folder_has_a_page_and_json(run: Run, tmp_path: Path) -> None:
    told = json.loads(run("inspect pool --json -").stdout)
    run("inspect pool --out pictures")
    assert json.loads((tmp_path / "pictures" / "inspection.json").read_text(encoding="utf-8")) == told
    assert [(trial["name"], trial["held_out"]) for trial in told["trials"]] == [("v1", False), ("v3", True)]
    assert {finding["code"] for finding in told["findings"]} >= {"design-no-turn"}
    assert "wall_effect" in told["undetectable"]
    page = (tmp_path / "pictures" / "inspection.html").read_text(encoding="utf-8")
    for text in ("design-no-turn", "the walls are not known", "<b>v1</b>", "held out, 521 samples at 50 Hz"):
        assert text in page
    headings = re.findall(r"<h2>(.*?)</h2>", page)
    assert headings == ["Contents", "Findings", "What the runs cannot show", "Channels"]
    assert re.findall(r'<a href="#section-\d">(.*?)</a>', page) == headings[1:]
    assert not re.search(r"""(src|href)=["']http""", re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL))


def test_a_channel_in_millimetres_blocks_with_its_code_and_exit_code_1(run: Run, pool: Path) -> None:
    dataset = mjfish.load_dataset(pool)
    scaled = [replace(trial, velocity=readonly(trial.velocity * [1e3, 1e3, 1.0])) for trial in dataset.trials]
    save(replace(dataset, trials=tuple(scaled), noise=None), pool)
    shown = run("inspect pool", exit_code=1).stdout
    assert re.search(r"blocks  signs-unit: all trials, surge: .* in mm/s; multiply by 0\.001", shown)
    assert re.search(r"findings? blocks? a diagnosis; mend that first", " ".join(shown.split()))


def test_what_is_no_dataset_is_refused(refuse: Callable[[str], str], tmp_path: Path) -> None:
    assert "absent" in refuse("inspect absent")
    (tmp_path / "empty").mkdir()
    assert "empty: has no dataset.toml" in refuse("inspect empty")
