"""Which coupling is right for which model; what would be silently wrong is refused, with the remedy.

``inertia`` is right under every integrator and with constraints, but needs the room for it in MuJoCo's inertia, which a
single body that moves about its own centre of mass does not have, and a solver that reads that inertia.
``xfrc`` is right where MuJoCo's acceleration is M^-1 (forces): implicit damping and constraints multiply by another
inertia, one that knows no added mass, and the error is large (the thrust may change its sign).

The checks are done again only where something that they read was changed: a block costs next to nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from operator import attrgetter
from typing import Literal, get_args

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjfish.errors import InputError, UnknownNameError
from mjfish.mujoco.block import carriers

Coupling = Literal["inertia", "xfrc"]

_IMPLICIT = {
    mujoco.mjtIntegrator.mjINT_IMPLICIT: "implicit",
    mujoco.mjtIntegrator.mjINT_IMPLICITFAST: "implicitfast",
    mujoco.mjtIntegrator.mjINT_DISCRETE: "discrete",
}
_Ids = NDArray[np.integer]


def choose(model: mujoco.MjModel, bodies: list[int], asked: Coupling | None) -> Coupling:
    """Return the coupling to use: the one asked for, or ``inertia`` where it is right, else ``xfrc``.

    Raises:
        UnknownNameError: no such coupling.
        InputError: what was asked for, or everything, would be wrong; every reason and its remedy, where both are wrong
                those of ``inertia``.
    """
    if asked is not None and asked not in get_args(Coupling):
        raise UnknownNameError("coupling", asked, get_args(Coupling), "or leave the choice to mjfish")
    reasons = list(_against_either(model, bodies))
    allowed: tuple[Coupling, ...] = ("inertia", "xfrc") if asked is None else (asked,)
    against = {"inertia": list(_against_inertia(model, bodies)), "xfrc": list(_against_xfrc(model))}
    other = {"inertia": "xfrc", "xfrc": "inertia"}
    if all(against[coupling] for coupling in allowed):  # where one of them is right, nothing is wrong with the other
        coupling = allowed[0]  # where neither is, the remedy of the one that is right more often
        way_out = "" if against[other[coupling]] else f', or use coupling="{other[coupling]}"'
        reasons += [f"coupling '{coupling}': {reason}{way_out}" for reason in against[coupling]]
    if reasons:
        raise InputError("\n".join(reasons))
    return next(coupling for coupling in allowed if not against[coupling])


def _disabled(model: mujoco.MjModel, bit: mujoco.mjtDisableBit) -> bool:
    return bool(model.opt.disableflags & bit)


def _enabled(model: mujoco.MjModel, bit: mujoco.mjtEnableBit) -> bool:
    return bool(model.opt.enableflags & bit)


def _names(model: mujoco.MjModel, kind: mujoco.mjtObj, ids: _Ids) -> str:
    return ", ".join(sorted({mujoco.mj_id2name(model, kind, int(i)) or f"#{i}" for i in ids}))


def _against_either(model: mujoco.MjModel, bodies: list[int]) -> Iterator[str]:
    """What spoils either coupling."""
    led = [body for body in bodies if model.body_mocapid[model.body_rootid[body]] >= 0]
    for wrong, reason in (
        (
            led,
            f"{_names(model, mujoco.mjtObj.mjOBJ_BODY, np.array(led))} hangs on a mocap body, whose velocity MuJoCo "
            "does not know; lead it by joints with servos, or by a weld to the mocap body",
        ),
        (
            _disabled(model, mujoco.mjtDisableBit.mjDSBL_ACTUATION),
            'actuation is disabled, so that MuJoCo never asks for the force; remove <flag actuation="disable"/>',
        ),
        (
            _enabled(model, mujoco.mjtEnableBit.mjENBL_OVERRIDE),
            'contact override is enabled, whose o_solimp holds the water; remove <flag override="enable"/>',
        ),
        (
            _enabled(model, mujoco.mjtEnableBit.mjENBL_SLEEP),
            'bodies may fall asleep, and the water with them; remove <flag sleep="enable"/>',
        ),
    ):
        if wrong:
            yield reason
    for name, value in (("density", model.opt.density), ("viscosity", model.opt.viscosity)):
        if value > 0.0:
            yield f"MuJoCo's own fluid of {name} {value:g} would act as well; set {name} of <option> to 0"


def _against_inertia(model: mujoco.MjModel, bodies: list[int]) -> Iterator[str]:
    if short := [body for body in bodies if not _has_room(model, body)]:
        names = _names(model, mujoco.mjtObj.mjOBJ_BODY, np.array(short))
        yield (
            f"MuJoCo stores the inertia of {names} as a diagonal, for it moves alone about its centre of mass; "
            "shift that by 1e-6 m in the MJCF (inertial pos)"
        )
    possible = list(_constraints(model))
    if possible and model.opt.solver == mujoco.mjtSolver.mjSOL_PGS:
        yield f'solver "PGS" does not see the added mass, and there may be {possible[0]}; set solver="Newton" or "CG"'
    if possible and model.opt.noslip_iterations > 0:
        yield f"noslip does not see the added mass, and there may be {possible[0]}; set noslip_iterations to 0"


def _has_room(model: mujoco.MjModel, body: int) -> bool:
    """Return whether each dof that moves the body has a whole row, up to the root."""
    rows, _ = carriers(model, [body])
    for _, _, first, count in rows.astype(int):
        for dof in range(first, first + count):
            depth, above = 1, int(model.dof_parentid[dof])
            while above >= 0:
                depth, above = depth + 1, int(model.dof_parentid[above])
            if model.M_rownnz[dof] != depth:
                return False
    return True


def _against_xfrc(model: mujoco.MjModel) -> Iterator[str]:
    integrator = model.opt.integrator
    if integrator in _IMPLICIT:
        yield (
            f"integrator '{_IMPLICIT[integrator]}' treats damping implicitly, without the added mass; "
            'set integrator="RK4"'
        )
    elif integrator == mujoco.mjtIntegrator.mjINT_EULER and not _disabled(model, mujoco.mjtDisableBit.mjDSBL_EULERDAMP):
        damped = (model.dof_damping > 0.0) | np.any(model.dof_dampingpoly != 0.0, axis=-1)
        for kind, damping in (
            (_names(model, mujoco.mjtObj.mjOBJ_JOINT, model.dof_jntid[damped]), damped),
            ("actuators", model.actuator_damping),
            ("tendons", model.tendon_damping),
        ):
            if np.any(damping > 0.0):
                yield (
                    f"integrator 'Euler' treats the damping of {kind} implicitly, without the added mass; "
                    'set <flag eulerdamp="disable"/> or integrator="RK4"'
                )
    for constraint in _constraints(model):
        yield f"there may be {constraint}, solved without the added mass; remove them"
    if np.any(model.tendon_armature > 0.0):
        yield "tendons have armature, which couples branches of a tree; remove it"


def _constraints(model: mujoco.MjModel) -> Iterator[str]:
    """Name what may become an active constraint."""
    bits = mujoco.mjtDisableBit
    if _disabled(model, bits.mjDSBL_CONSTRAINT):
        return
    limited, rubbing = np.flatnonzero(model.jnt_limited), np.flatnonzero(model.dof_frictionloss > 0.0)
    touching = np.flatnonzero((model.geom_contype | model.geom_conaffinity) != 0)
    joints = mujoco.mjtObj.mjOBJ_JOINT
    for possible, bit, constraint in (
        (limited.size, bits.mjDSBL_LIMIT, f"joint limits of {_names(model, joints, limited)}"),
        (
            rubbing.size,
            bits.mjDSBL_FRICTIONLOSS,
            f"frictionloss of {_names(model, joints, model.dof_jntid[rubbing])}",
        ),
        (model.neq, bits.mjDSBL_EQUALITY, "equality constraints"),
        (np.any(model.tendon_limited), bits.mjDSBL_LIMIT, "limits of tendons"),
        (np.any(model.tendon_frictionloss > 0.0), bits.mjDSBL_FRICTIONLOSS, "frictionloss of tendons"),
        (touching.size > 1 or model.npair, bits.mjDSBL_CONTACT, "contacts"),
    ):
        if possible and not _disabled(model, bit):
            yield constraint


#: What the checks here and in `mjfish.mujoco.memory` read of a model, but for sizes and names, which stay.
FIELDS = (
    "body_mocapid", "body_rootid", "body_parentid", "body_dofadr", "body_dofnum", "dof_parentid", "M_rownnz",
    "dof_jntid", "dof_damping", "dof_dampingpoly", "dof_frictionloss", "jnt_limited", "geom_contype",
    "geom_conaffinity", "tendon_damping", "tendon_armature", "tendon_limited", "tendon_frictionloss",
    "actuator_damping", "actuator_dyntype", "actuator_gaintype", "actuator_gainprm", "actuator_biastype",
    "actuator_ctrllimited", "actuator_actlimited", "actuator_group", "actuator_actadr",
)  # fmt: skip
#: The same of its options.
OPTIONS = (
    "disableflags", "enableflags", "density", "viscosity", "solver", "noslip_iterations", "integrator",
    "disableactuator",
)  # fmt: skip
_options = attrgetter(*OPTIONS)


class Checked:
    """A model that passed its checks, and what they read then."""

    def __init__(self, model: mujoco.MjModel, check: Callable[[], object]) -> None:
        """Remember a model as it is: it has just passed.

        Args:
            model: the model.
            check: raises where the model is no longer right.
        """
        self._check = check
        self._opt = model.opt
        self._fields = [getattr(model, name) for name in FIELDS]  # views: they show what is changed in place
        self._seen = self._now()

    def _now(self) -> tuple[object, bytes]:
        return _options(self._opt), b"".join(self._fields)

    def again(self) -> None:
        """Check the model again where it was changed.

        Raises:
            InputError: as the check says.
        """
        now = self._now()
        if now != self._seen:
            self._check()
            self._seen = now
