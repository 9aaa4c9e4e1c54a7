"""Which coupling for which model: what would be wrong is refused, and the remedy it names is one."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
import pytest
from wet_models import PLATE, PLATE_LINK, TREE, compiled, tree, tree_links

from mjfish.errors import InputError, UnknownNameError
from mjfish.mujoco import StripFluid

_OFF, _ON = mujoco.mjtDisableBit, mujoco.mjtEnableBit
_INTEGRATORS = mujoco.mjtIntegrator
Change = Callable[[mujoco.MjModel], None]


def _disable(bit: mujoco.mjtDisableBit) -> Change:
    def change(model: mujoco.MjModel) -> None:
        model.opt.disableflags |= bit

    return change


def _enable(bit: mujoco.mjtEnableBit) -> Change:
    def change(model: mujoco.MjModel) -> None:
        model.opt.enableflags |= bit

    return change


def _option(name: str, value: float) -> Change:
    def change(model: mujoco.MjModel) -> None:
        setattr(model.opt, name, value)

    return change


def _limited(model: mujoco.MjModel) -> None:
    model.jnt_limited[model.joint("tail").id] = 1


def _rubbing(model: mujoco.MjModel) -> None:
    model.dof_frictionloss[model.joint("weight").dofadr] = 0.1


def _touching(model: mujoco.MjModel) -> None:
    model.geom_contype[:] = 1


EITHER = {
    "actuation": (_disable(_OFF.mjDSBL_ACTUATION), r'never asks for the force; remove <flag actuation="disable"/>'),
    "override": (_enable(_ON.mjENBL_OVERRIDE), r'remove <flag override="enable"/>'),
    "sleep": (_enable(_ON.mjENBL_SLEEP), r'remove <flag sleep="enable"/>'),
    "density": (
        _option("density", 1000.0),
        "MuJoCo's own fluid of density 1000 would act as well; set density of <option> to 0$",
    ),
    "viscosity": (
        _option("viscosity", 1e-3),
        "of viscosity 0.001 would act as well; set viscosity of <option> to 0$",
    ),
}


@pytest.mark.parametrize("coupling", [None, "inertia", "xfrc"])
@pytest.mark.parametrize("name", EITHER)
def test_model_that_spoils_either_coupling_is_refused_with_the_remedy(name: str, coupling: str | None) -> None:
    """At the start and, where it is spoilt later, at the next block; the model is then left as it was."""
    spoil, message = EITHER[name]
    fluid = tree(coupling)
    with fluid.installed():
        pass  # the model as it comes is fine
    spoil(fluid.model)
    with pytest.raises(InputError, match=message), fluid.installed():
        pass
    assert mujoco.get_mjcb_control() is None
    model = compiled(TREE)
    spoil(model)
    flags, tag = model.opt.disableflags, model.opt.o_solimp.copy()
    with pytest.raises(InputError, match=message):
        StripFluid(model, tree_links(), coupling=coupling)  # type: ignore[arg-type]
    assert model.opt.disableflags == flags
    np.testing.assert_array_equal(model.opt.o_solimp, tag)


XFRC = {
    "implicit": (_option("integrator", _INTEGRATORS.mjINT_IMPLICIT), r"integrator 'implicit' .*integrator=\"RK4\""),
    "implicitfast": (_option("integrator", _INTEGRATORS.mjINT_IMPLICITFAST), r"integrator 'implicitfast' treats"),
    "discrete": (_option("integrator", _INTEGRATORS.mjINT_DISCRETE), r"integrator 'discrete' treats"),
    "Euler": (_option("integrator", _INTEGRATORS.mjINT_EULER), r"'Euler' .*damping of weight .*eulerdamp=\"disable\""),
    "limits": (
        _limited,
        r"limits of tail, solved without the added mass; remove them, or use coupling=\"inertia\"$",
    ),
    "frictionloss": (_rubbing, r"frictionloss of weight, solved without"),
    "contacts": (_touching, r"there may be contacts, solved without"),
}


@pytest.mark.parametrize("name", XFRC)
def test_what_breaks_xfrc_is_refused_and_inertia_taken_instead(name: str) -> None:
    """Catches a run whose implicit damping or constraints know nothing of the added mass: the thrust turns round."""
    spoil, message = XFRC[name]
    fluid = tree("xfrc")
    spoil(fluid.model)
    with pytest.raises(InputError, match=message), fluid.installed():
        pass
    model = compiled(TREE)
    spoil(model)
    with pytest.raises(InputError, match=f"coupling 'xfrc': .*{message}"):
        StripFluid(model, tree_links(), coupling="xfrc")
    assert StripFluid(model, tree_links()).coupling == "inertia"


_FIXED = '<tendon><fixed {}><joint joint="tail" coef="1"/></fixed></tendon>'
ADDED = {
    "equality": ('<equality><joint joint1="tail"/></equality>', "there may be equality constraints, solved without"),
    "tendon limit": (_FIXED.format('limited="true" range="-1 1"'), "there may be limits of tendons, solved"),
    "tendon friction": (_FIXED.format('frictionloss=".1"'), "there may be frictionloss of tendons, solved"),
    "tendon armature": (_FIXED.format('armature=".1"'), "tendons have armature, which couples branches of a tree"),
    "tendon damping": (_FIXED.format('damping=".1"'), "integrator 'Euler' treats the damping of tendons implicitly"),
    "actuator damping": (
        '<actuator><motor joint="tail" damping=".1"/></actuator>',
        "integrator 'Euler' treats the damping of actuators implicitly",
    ),
}


@pytest.mark.parametrize("name", ADDED)
def test_what_else_breaks_xfrc_is_refused_and_inertia_taken_instead(name: str) -> None:
    element, message = ADDED[name]
    xml = TREE.replace("</mujoco>", element + "</mujoco>")
    integrator = "euler" if name.endswith("damping") else "rk4"
    with pytest.raises(InputError, match=message):
        StripFluid(compiled(xml, integrator=integrator), tree_links(), coupling="xfrc")
    assert StripFluid(compiled(xml, integrator=integrator), tree_links()).coupling == "inertia"


CURED = {
    "Euler without eulerdamp": (_disable(_OFF.mjDSBL_EULERDAMP), XFRC["Euler"][0]),
    "limits disabled": (_disable(_OFF.mjDSBL_LIMIT), _limited),
    "frictionloss disabled": (_disable(_OFF.mjDSBL_FRICTIONLOSS), _rubbing),
    "contacts disabled": (_disable(_OFF.mjDSBL_CONTACT), _touching),
    "constraints disabled": (_disable(_OFF.mjDSBL_CONSTRAINT), _limited),
}


@pytest.mark.parametrize("name", CURED)
def test_remedy_of_xfrc_is_one(name: str) -> None:
    cure, spoil = CURED[name]
    model = compiled(TREE)
    spoil(model)
    cure(model)
    fluid = StripFluid(model, tree_links(), coupling="xfrc")
    with fluid.installed():
        assert fluid.coupling == "xfrc"


@pytest.mark.parametrize("integrator", ["euler", "rk4", "implicit", "implicitfast", "discrete"])
def test_inertia_is_the_default_of_every_integrator(integrator: str) -> None:
    assert tree(integrator=integrator).coupling == "inertia"


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (_option("solver", mujoco.mjtSolver.mjSOL_PGS), r'solver "PGS" .* joint limits of tail; set solver="Newton"'),
        (_option("noslip_iterations", 3), r"noslip does not see .* joint limits of tail; set noslip_iterations to 0"),
    ],
)
def test_solver_that_does_not_see_the_added_mass_is_refused_where_it_may_be_called(spoil: Change, message: str) -> None:
    model = compiled(TREE)
    spoil(model)
    assert StripFluid(model, tree_links()).coupling == "inertia"
    _limited(model)
    with pytest.raises(InputError, match=f"coupling 'inertia': {message}"):
        StripFluid(model, tree_links(), coupling="inertia")


def _alone(com: str) -> mujoco.MjModel:
    """Return a free body whose centre of mass is at `com`."""
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><worldbody><body name="plate"><freejoint/>
        <inertial pos="{com}" mass="1" diaginertia="1e-3 2e-3 3e-3"/></body></worldbody></mujoco>"""
    )


def test_body_alone_about_its_centre_of_mass_has_no_room_for_inertia_until_that_is_shifted() -> None:
    """MuJoCo stores only the diagonal of its inertia: the added mass across would be lost."""
    with pytest.raises(InputError, match=r"inertia of plate as a diagonal.*shift that by 1e-6 m"):
        StripFluid(_alone("0 0 0"), [PLATE_LINK], coupling="inertia")
    short = _alone("0 0 0")
    short.opt.integrator = _INTEGRATORS.mjINT_RK4
    assert StripFluid(short, [PLATE_LINK]).coupling == "xfrc"
    assert StripFluid(_alone("1e-6 0 0"), [PLATE_LINK], coupling="inertia").coupling == "inertia"
    assert StripFluid(compiled(PLATE), [PLATE_LINK]).coupling == "inertia"


def test_body_that_hangs_on_a_mocap_body_is_refused() -> None:
    """It would be led through the water without drag: MuJoCo moves it, and knows no velocity of it."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><body name="hand" mocap="true"><body name="plate"><joint/>
        <geom type="box" size=".1 .01 .1"/></body></body></worldbody></mujoco>"""
    )
    for body in ("hand", "plate"):
        with pytest.raises(InputError, match=f"{body} hangs on a mocap body, whose velocity .*; lead it by joints"):
            StripFluid(model, [{**PLATE_LINK, "body": body}])


def test_unknown_coupling_lists_those_there_are() -> None:
    with pytest.raises(UnknownNameError, match="unknown coupling 'lagged'; known: inertia, xfrc"):
        tree("lagged")


def test_autoreset_is_disabled() -> None:
    model = compiled(TREE)
    assert not model.opt.disableflags & _OFF.mjDSBL_AUTORESET
    StripFluid(model, tree_links())
    assert model.opt.disableflags & _OFF.mjDSBL_AUTORESET


_ALONE = """<mujoco><option integrator="implicitfast"/><worldbody><body name="plate"><freejoint/>
<geom type="box" size=".1 .1 .1" contype="0" conaffinity="0"/></body></worldbody></mujoco>"""


def _refusal(model: mujoco.MjModel, links: list[dict[str, object]], coupling: str | None = None) -> list[str]:
    with pytest.raises(InputError) as refused:
        StripFluid(model, links, coupling=coupling)  # type: ignore[arg-type]
    return str(refused.value).splitlines()


def test_refusal_names_only_what_is_wrong() -> None:
    """What would break the coupling that is not needed is not told; neither is a remedy that is none."""
    model = compiled(TREE, integrator="implicitfast")
    model.opt.density = 1000.0
    _limited(model)
    found = _refusal(model, tree_links())
    assert found == ["MuJoCo's own fluid of density 1000 would act as well; set density of <option> to 0"]
    (either,) = _refusal(compiled(_ALONE), [PLATE_LINK])  # where neither is right, the remedy of one is enough
    assert either.startswith("coupling 'inertia': ")
    assert either.endswith("shift that by 1e-6 m in the MJCF (inertial pos)")
    explicit = _refusal(compiled(_ALONE, integrator="rk4"), [PLATE_LINK], "inertia")
    assert len(explicit) == 1
    assert explicit[0].endswith('(inertial pos), or use coupling="xfrc"')
