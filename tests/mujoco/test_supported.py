"""The MuJoCo that is needed: an older one is refused in words, and the oldest is the one that is declared."""

from __future__ import annotations

import ast
import subprocess
import sys
import tomllib
from operator import attrgetter
from pathlib import Path

import mujoco
import numpy as np
import pytest
from wet_models import RK4_ORDER

from mjfish.errors import MjfishError
from mjfish.mujoco import supported

_ROOT = Path(__file__).parents[2]


def test_a_mujoco_without_a_needed_name_is_refused_with_its_version(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mujoco, "__version__", "3.12.0")
    supported.check()
    monkeypatch.delattr(mujoco, "MjSpec")
    with pytest.raises(MjfishError, match=r"MuJoCo 3.12.0 has no MjSpec, expected MuJoCo 3.13 or later; .*>=3.13'"):
        supported.check()


def test_the_first_import_of_the_water_says_it() -> None:
    """Before any import of a name fails; the name is the one that the oldest MuJoCo has and those before have not."""
    script = (
        "import types, mujoco\n"
        "class Older: pass\n"
        "mujoco.mjtIntegrator = Older\n"
        "mujoco.__version__ = '3.12.0'\n"
        "import mjfish\n"
        "try:\n"
        "    mjfish.StripFluid\n"
        "except mjfish.MjfishError as error:\n"
        "    print(error)\n"
    )
    ran = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert ran.stdout.startswith("MuJoCo 3.12.0 has no mjtIntegrator.mjINT_DISCRETE, expected MuJoCo 3.13"), ran.stderr


def test_the_oldest_mujoco_is_the_bound_of_the_package() -> None:
    declared = tomllib.loads((_ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["dependencies"]
    assert f"mujoco>={supported.OLDEST},<5" in declared


def test_every_name_that_is_used_is_there() -> None:
    """Also of lines that no test runs; with the oldest MuJoCo this finds what is newer than it."""
    chains = set()
    for file in (_ROOT / "mjfish" / "mujoco").glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            found, _, name = ast.unparse(node).partition(".") if isinstance(node, ast.Attribute) else ("", "", "")
            if found == "mujoco" and name.replace(".", "").isidentifier():
                chains.add(name)
    assert len(chains) > 50
    for chain in chains:
        attrgetter(chain)(mujoco)


def test_the_order_of_rk4_where_a_body_turns_in_space() -> None:
    """Of MuJoCo alone, without water: second before 4.0."""
    ends = []
    for step in (0.01, 0.005, 0.0025):
        model = mujoco.MjModel.from_xml_string(
            f'<mujoco><option integrator="RK4" gravity="0 0 0" timestep="{step}"/>'
            '<worldbody><body><freejoint/><geom type="ellipsoid" size=".3 .2 .1"/></body></worldbody></mujoco>'
        )
        data = mujoco.MjData(model)
        data.qvel[:] = 0.1, 0.2, 0.3, 3.0, 2.0, 1.0
        mujoco.mj_step(model, data, nstep=round(1.0 / step))
        ends.append(data.qpos.copy())
    coarse, fine = np.abs(np.diff(ends, axis=0)).max(axis=1)
    assert np.log2(coarse / fine) == pytest.approx(RK4_ORDER, abs=0.05)
