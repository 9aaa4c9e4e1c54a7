"""Water lives as long as its model; where it is gone, replaced, or cannot be right, a run is spoilt and never dry."""

from __future__ import annotations

import copy
import gc
import pickle
import re
import subprocess
import sys
import weakref
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest
from wet_models import PLATE, PLATE_LINK, TREE, compiled, stirred, tree, tree_links

from mjfish.errors import InputError, MjfishError
from mjfish.mujoco import StripFluid, block

_GONE = r"the StripFluid of this model is gone; keep it as long as .* or call StripFluid\(model, links\) on this one"
_IMPLICITFAST = mujoco.mjtIntegrator.mjINT_IMPLICITFAST


def _rows() -> int:
    gc.collect()
    return len(block._free)


def _spoilt(model: mujoco.MjModel, fluid: StripFluid, cause: str) -> mujoco.MjData:
    """Step a model while `fluid` is installed and assert that everybody can see what happened, and nothing else."""
    data = stirred(model)
    with fluid.installed():
        mujoco.mj_forward(model, data)
        assert np.all(np.isnan(data.qacc))
        mujoco.mj_step(model, data)
        mujoco.mj_step(model, data)
    found = fluid.state(data)
    assert found.status == "diverged"
    assert re.fullmatch(f"the state is no longer one of numbers at {data.time:.4f} s: {cause}", found.message)
    assert data.time > 0.0, "a reset"
    return data


def test_water_lives_with_its_model_when_the_fluid_is_let_go() -> None:
    model = compiled(TREE)
    StripFluid(model, tree_links())
    gc.collect()
    data, other = stirred(model), tree()
    with other.installed():
        mujoco.mj_step(model, data)
        mujoco.mj_step(other.model, same := stirred(other.model))
    np.testing.assert_array_equal(data.qvel, same.qvel)


def test_copy_that_outlives_its_water_is_spoilt() -> None:
    """Catches a copy that runs dry, and one that finds the water of whoever took the row over."""
    fluid = tree()
    left = copy.copy(fluid.model)
    row = int(left.opt.o_solimp[2])
    del fluid
    gc.collect()
    others = [tree() for _ in range(3)]
    assert row in [int(other.model.opt.o_solimp[2]) for other in others], "the row is given away again"
    _spoilt(left, others[0], _GONE)
    with pytest.raises(InputError, match=_GONE):
        block.block_of(left)
    StripFluid(left, tree_links())  # as the message says
    with others[0].installed():
        mujoco.mj_step(left, data := stirred(left))
    assert np.all(np.isfinite(data.qacc))


def test_model_saved_as_xml_and_read_again_is_spoilt() -> None:
    """MuJoCo writes the tag in seven digits: it leads nowhere."""
    fluid = StripFluid(mujoco.MjModel.from_xml_string(TREE), tree_links())
    mujoco.mj_saveLastXML("saved.xml", fluid.model)
    model = mujoco.MjModel.from_xml_path("saved.xml")
    assert model.opt.o_solimp[0] == block.MAGIC
    _spoilt(model, fluid, _GONE)


_CHILD = """
import pickle, sys
from pathlib import Path
import mujoco, numpy as np
from wet_models import stirred, tree, tree_links, full_state
from mjfish.mujoco import StripFluid
model = pickle.loads(Path("model.pickle").read_bytes())
fluid = tree()
data = stirred(model)
with fluid.installed():
    mujoco.mj_step(model, data)
    assert np.isnan(data.qacc).all(), "dry, or in the water of another"
assert fluid.state(data).status == "diverged"
own = StripFluid(model, tree_links())
data = stirred(model)
with own.installed():
    mujoco.mj_step(model, data, nstep=20)
np.save("state.npy", full_state(model, data))
"""


def test_model_pickled_into_another_process_is_spoilt_until_it_has_water_there() -> None:
    fluid = tree()
    Path("model.pickle").write_bytes(pickle.dumps(fluid.model))
    path = f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r})\n"
    done = subprocess.run([sys.executable, "-c", path + _CHILD], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    data = stirred(fluid.model)
    with fluid.installed():
        mujoco.mj_step(fluid.model, data, nstep=20)
    np.testing.assert_array_equal(np.load("state.npy")[1 : 1 + fluid.model.nq], data.qpos)


def test_second_water_replaces_the_first_which_says_so() -> None:
    """Catches a first StripFluid that goes on as if its coefficients still held."""
    first = tree(c_d=0.0)
    second = StripFluid(first.model, tree_links(c_d=2.0))
    alone = tree(c_d=2.0)
    replaced, expected = stirred(first.model), stirred(alone.model)
    with second.installed():
        mujoco.mj_step(first.model, replaced)
        mujoco.mj_step(alone.model, expected)
    np.testing.assert_array_equal(replaced.qvel, expected.qvel)
    with pytest.raises(InputError, match="another StripFluid has taken the place of this one"), first.installed():
        pass
    with pytest.raises(InputError, match="use that one, with the links of both"):
        first.wrenches(replaced)


def test_tag_that_was_overwritten_is_seen() -> None:
    fluid = tree()
    fluid.model.opt.o_solimp[0] = 0.9
    with pytest.raises(InputError, match=r"opt\.o_solimp: found another value than the tag"), fluid.installed():
        pass


def test_rows_are_freed_with_their_models() -> None:
    before = _rows()
    kept = [tree() for _ in range(5)]
    assert _rows() == before - 5
    copies = [copy.copy(fluid.model) for fluid in kept]
    del kept
    assert _rows() == before
    assert len(copies) == 5


def test_a_thousand_waters_on_one_model_leave_one() -> None:
    before = _rows()
    model = compiled(TREE)
    links = StripFluid(model, tree_links()).links
    gone = weakref.ref(StripFluid(model, links)._block)
    for _ in range(1000):
        fluid = StripFluid(model, links)
    assert _rows() == before - 1
    assert gone() is None
    del fluid, model
    assert _rows() == before


def test_too_many_waters_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(block, "_free", [])
    with pytest.raises(MjfishError, match="models with water live at once; drop some of them"):
        tree()


def _nan(data: mujoco.MjData) -> None:
    data.qpos[0] = np.nan


def _huge(data: mujoco.MjData) -> None:
    data.qvel[-1] = 1e12


@pytest.mark.parametrize("coupling", ["inertia", "xfrc"])
@pytest.mark.parametrize("spoil", [_nan, _huge])
def test_state_that_is_no_number_is_a_status_and_no_reset(
    spoil: Callable[[mujoco.MjData], None], coupling: str
) -> None:
    """MuJoCo would set the time back to zero and go on from the start, with a line in a log."""
    fluid = tree(coupling)
    data = stirred(fluid.model)
    with fluid.installed():
        mujoco.mj_step(fluid.model, data, nstep=3)
        assert fluid.state(data) == type(fluid.state(data))("ok", "")
        spoil(data)
        mujoco.mj_step(fluid.model, data, nstep=3)
    assert data.time == pytest.approx(6 * fluid.model.opt.timestep)
    found = fluid.state(data)
    assert found.status == "diverged"
    assert "at 0.0120 s; take a shorter step" in found.message


def test_state_beyond_all_sense_is_a_status_though_it_is_a_number() -> None:
    fluid = StripFluid(compiled(PLATE), [{**PLATE_LINK, "c_d": 0.0, "c_f": 0.0}])
    data = mujoco.MjData(fluid.model)
    data.qvel[0] = 1e11
    with fluid.installed():
        mujoco.mj_step(fluid.model, data)
    assert np.all(np.isfinite(data.qacc))
    assert fluid.state(data).status == "diverged"
    mujoco.mj_resetData(fluid.model, data)  # by the user, who starts again
    assert fluid.state(data).status == "ok"


def test_step_that_is_too_long_is_a_status_and_no_reset() -> None:
    fluid = tree(integrator="euler")
    fluid.model.opt.timestep = 0.5
    data = stirred(fluid.model)
    with fluid.installed():
        mujoco.mj_step(fluid.model, data, nstep=100)
    assert fluid.state(data).status == "diverged"
    assert data.time == pytest.approx(50.0)


def _implicitly(model: mujoco.MjModel) -> None:
    model.opt.integrator = _IMPLICITFAST


def _against_a_stop(model: mujoco.MjModel) -> None:
    model.jnt_limited[model.joint("tail").id] = 1
    model.jnt_range[model.joint("tail").id] = (-1e-3, 1e-3)


@pytest.mark.parametrize(
    ("spoil", "cause"),
    [(_implicitly, "integrator 'implicitfast' treats .*"), (_against_a_stop, "there may be joint limits of tail, .*")],
)
def test_xfrc_that_becomes_wrong_is_refused_before_and_spoilt_inside_a_block(
    spoil: Callable[[mujoco.MjModel], None], cause: str
) -> None:
    """The answer would be wrong by half: better none."""
    fluid = tree("xfrc")
    model = copy.copy(fluid.model)
    spoil(model)
    _spoilt(model, fluid, f"coupling 'xfrc': {cause}")
    spoil(fluid.model)
    with pytest.raises(InputError, match='use coupling="inertia"'), fluid.installed():
        pass
    inertia = tree("inertia")
    spoil(inertia.model)
    with inertia.installed():
        mujoco.mj_step(inertia.model, data := stirred(inertia.model), nstep=5)
    assert inertia.state(data).status == "ok"
