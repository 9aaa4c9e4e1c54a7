"""The checks of a model, done again only where something that they read was changed: a block costs next to nothing."""

from __future__ import annotations

from collections.abc import Callable
from operator import attrgetter

import mujoco

#: What `mjfish.mujoco.coupling_choice` and `mjfish.mujoco.memory` read of a model, but for sizes and names, which stay.
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
