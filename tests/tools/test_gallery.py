"""The gallery of mechanisms, and the site that it is part of."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gallery import pages, swims
from mjfish.effects import catalogue, find
from mjfish.effects.mechanism import MECHANISMS

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
def test_every_formula_has_its_equation_parameters_and_picture(tmp_path: Path) -> None:
    written = pages.write(tmp_path)
    assert {page.stem for page in written} == {"index", *MECHANISMS}
    index = written[0].read_text(encoding="utf-8")
    for name, effect in catalogue().items():
        text = (tmp_path / f"{effect.mechanism}.md").read_text(encoding="utf-8")
        assert f"({effect.mechanism}.md)" in index
        assert f"## {name}\n" in text
        assert pages.about(effect) in text
        if not effect.learned:
            assert all(f"`{p.name}`" in text for p in effect.parameters)
            assert f"({name}.svg)" in text
            assert (tmp_path / f"{name}.svg").read_text(encoding="utf-8").count("<path") > 10


@pytest.mark.parametrize("name", ["velocity_scale", "tail_compliance", "ambient_current"])
def test_a_cause_is_drawn_at_the_size_that_changes_a_swim_by_a_tenth(name: str) -> None:
    swim = swims.swim(find(name))
    wrong, velocity = (x / np.array(swims.SIGMA) for x in (swim.changed - swim.nominal, swim.nominal))
    assert np.sqrt(np.mean(wrong**2) / np.mean(velocity**2)) == pytest.approx(swims.CHANGE, rel=0.01)


def test_the_curve_is_the_formula() -> None:
    """The tail's moment is its deflection over the compliance; drag falls as the power of the speed."""
    (spring,) = swims.curves(find("tail_compliance"))
    compliance = swims.swim(find("tail_compliance")).values["tail_compliance.compliance"]
    np.testing.assert_allclose(spring.y.values, np.array(spring.x.values) / compliance, rtol=1e-3)
    across = next(curve for curve in swims.curves(find("power_drag")) if curve.quantity == "c_d")
    power = swims.swim(find("power_drag")).values["power_drag.pressure"]
    slope = np.polyfit(np.log(across.x.values), np.log(across.y.values), 1)[0]
    assert slope == pytest.approx(power, abs=0.01)


@pytest.mark.slow
def test_the_site_is_built_without_a_warning_and_its_notebooks_run(tmp_path: Path) -> None:
    build = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", "docs", str(tmp_path)]
    done = subprocess.run(build, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    notebook = (tmp_path / "notebooks" / "diagnosis.html").read_text(encoding="utf-8")
    assert "The cause is tail_compliance" in notebook
    assert "plotly" in notebook
    assert (tmp_path / "gallery" / "drag_law.html").is_file()
