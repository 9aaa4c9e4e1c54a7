"""Refusal of models in which the water's force would come out wrong: the scheme needs qacc = M^-1 (forces).

Implicit damping and active constraints multiply by another inertia than M, one that knows no added mass; the error is
large (the thrust may even change its sign), so that such models are refused, with the remedy.
"""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjfish.errors import InputError

_IMPLICIT = {
    mujoco.mjtIntegrator.mjINT_IMPLICIT: "implicit",
    mujoco.mjtIntegrator.mjINT_IMPLICITFAST: "implicitfast",
    mujoco.mjtIntegrator.mjINT_DISCRETE: "discrete",
}


def require_compatible(model: mujoco.MjModel) -> None:
    """Raise `InputError`, with every reason and its remedy, where the water's force would be wrong in `model`."""
    reasons = [*_integration(model), *_constraints(model), *_flags(model)]
    if reasons:
        raise InputError("the force of the water would be wrong in this MuJoCo model:\n" + "\n".join(reasons))


def _disabled(model: mujoco.MjModel, bit: mujoco.mjtDisableBit) -> bool:
    return bool(model.opt.disableflags & bit)


def _names(model: mujoco.MjModel, kind: mujoco.mjtObj, ids: NDArray[np.integer]) -> str:
    return ", ".join(sorted({mujoco.mj_id2name(model, kind, int(i)) or f"#{i}" for i in ids}))


def _integration(model: mujoco.MjModel) -> Iterator[str]:
    integrator = model.opt.integrator
    if integrator in _IMPLICIT:
        yield (
            f"integrator '{_IMPLICIT[integrator]}' treats damping implicitly, without the added mass; "
            'set integrator="RK4" (or "Euler" with eulerdamp disabled)'
        )
    elif integrator == mujoco.mjtIntegrator.mjINT_EULER and not _disabled(model, mujoco.mjtDisableBit.mjDSBL_EULERDAMP):
        damped = np.flatnonzero(model.dof_damping > 0.0)
        if damped.size:
            names = _names(model, mujoco.mjtObj.mjOBJ_JOINT, model.dof_jntid[damped])
            yield (
                f"integrator 'Euler' treats the damping of {names} implicitly, without the added mass; "
                'set <flag eulerdamp="disable"/> or integrator="RK4"'
            )


def _constraints(model: mujoco.MjModel) -> Iterator[str]:
    bits = mujoco.mjtDisableBit
    if _disabled(model, bits.mjDSBL_CONSTRAINT):
        return
    limited = np.flatnonzero(model.jnt_limited)
    if limited.size and not _disabled(model, bits.mjDSBL_LIMIT):
        names = _names(model, mujoco.mjtObj.mjOBJ_JOINT, limited)
        yield f'joint limits of {names}; remove their range or set <flag limit="disable"/>'
    rubbing = np.flatnonzero(model.dof_frictionloss > 0.0)
    if rubbing.size and not _disabled(model, bits.mjDSBL_FRICTIONLOSS):
        names = _names(model, mujoco.mjtObj.mjOBJ_JOINT, model.dof_jntid[rubbing])
        yield f'frictionloss of {names}; remove it or set <flag frictionloss="disable"/>'
    if model.neq and not _disabled(model, bits.mjDSBL_EQUALITY):
        yield 'equality constraints; remove them or set <flag equality="disable"/>'
    if np.any(model.tendon_limited) or np.any(model.tendon_frictionloss > 0.0):
        yield "limits or frictionloss of tendons; remove them"
    touching = np.flatnonzero((model.geom_contype | model.geom_conaffinity) != 0)
    if (touching.size > 1 or model.npair) and not _disabled(model, bits.mjDSBL_CONTACT):
        yield 'geoms that can touch; set contype="0" conaffinity="0", or <flag contact="disable"/>'


def _flags(model: mujoco.MjModel) -> Iterator[str]:
    bits = mujoco.mjtDisableBit
    if _disabled(model, bits.mjDSBL_ACTUATION):
        yield 'actuation is disabled, so that MuJoCo never asks for the force; remove <flag actuation="disable"/>'
    if not _disabled(model, bits.mjDSBL_AUTORESET):
        yield 'a run that diverges would silently start again; set <flag autoreset="disable"/>'
