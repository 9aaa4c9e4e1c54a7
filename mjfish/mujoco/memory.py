"""Room for the hidden states of loads in a MuJoCo model: activations of actuators that push with nothing.

The activation a of an actuator with ``dyntype="integrator"`` obeys a' = ctrl, and its force is gain times a; the gain
is 0 here. The water writes the rates of the hidden states into ctrl. Activations are a part of MuJoCo's state: every
integrator advances them at its own order, in the stages of RK4 too; they are saved, copied, reset to zero and
differentiated with it, in every thread, and a second `mj_forward` changes nothing.
"""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from mjfish.errors import InputError

#: Names of the actuators: this, then their number from 1 on.
PREFIX = "strip_fluid/memory/"


class Room(NamedTuple):
    """Where the hidden states are.

    Attributes:
        states: how many the loads have.
        control: index of the first one's rate in `ctrl`.
        activation: index of the first one in `act`.
    """

    states: int
    control: int
    activation: int


def make_room(spec: mujoco.MjSpec, states: int) -> None:
    """Add an actuator for each hidden state to a model, behind all others; the model needs a joint.

    Args:
        spec: the model.
        states: number of hidden states, see `mjfish.hydro.load.memory_of`.
    """
    for number in range(1, states + 1):
        joint = spec.joints[0]
        joint.name = joint.name or f"{PREFIX}joint"  # actuators name what they act on
        actuator = spec.add_actuator(
            name=f"{PREFIX}{number}",
            target=joint.name,
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            dyntype=mujoco.mjtDyn.mjDYN_INTEGRATOR,
            gaintype=mujoco.mjtGain.mjGAIN_FIXED,
            biastype=mujoco.mjtBias.mjBIAS_NONE,  # whatever the model's defaults are
            ctrllimited=mujoco.mjtLimited.mjLIMITED_FALSE,
            actlimited=mujoco.mjtLimited.mjLIMITED_FALSE,
        )
        actuator.gainprm[0] = 0.0


def room_in(model: mujoco.MjModel, states: int) -> Room:
    """Return where a model keeps so many hidden states.

    Raises:
        InputError: it has less room, or would not integrate them as they are.
    """
    ids = [i for i in range(model.nu) if model.actuator(i).name.startswith(PREFIX)] if states else []
    if len(ids) < states:
        joint = next(filter(None, (model.joint(j).name for j in range(model.njnt))), "JOINT")
        raise InputError(
            f"actuators: found {len(ids)} named '{PREFIX}1' and so on, expected {states}, one a hidden state of the "
            f'loads; add <general name="{PREFIX}1" joint="{joint}" dyntype="integrator" gainprm="0"/> and so on, or '
            f"call mjfish.mujoco.memory.make_room(spec, {states})"
        )
    if not ids:
        return Room(0, 0, 0)
    pushing = (model.actuator_gaintype[ids] != mujoco.mjtGain.mjGAIN_FIXED) | (model.actuator_gainprm[ids, 0] != 0.0)
    pushing |= model.actuator_biastype[ids] != mujoco.mjtBias.mjBIAS_NONE
    limited = (model.actuator_ctrllimited[ids] != 0) | (model.actuator_actlimited[ids] != 0)
    disabled = (model.opt.disableactuator >> model.actuator_group[ids].clip(0)) & 1 > 0
    for wrong, found, remedy in (
        (
            model.actuator_dyntype[ids] != mujoco.mjtDyn.mjDYN_INTEGRATOR,
            "is no integrator",
            'set dyntype="integrator"',
        ),
        (pushing, "pushes", 'set gaintype="fixed" gainprm="0" biastype="none"'),
        (limited, "is limited", "take out its ctrlrange and actrange"),
        (disabled, "is disabled", "take its group out of actuatorgroupdisable"),
        (np.diff(ids, prepend=ids[0] - 1) != 1, "is not next to the one before", "list them one after the other"),
    ):
        if wrong.any():
            name = model.actuator(ids[int(np.argmax(wrong))]).name
            raise InputError(f"actuator '{name}' {found}, expected free room for a hidden state of a load; {remedy}")
    return Room(states, ids[0], int(model.actuator_actadr[ids[0]]))
