"""What may be wrong in the sealed world: causes on the solver's list, off it, decoys; directions at random.

Names of parameters on the list are those of the
solver where the definitions agree; `exact` says whether they do, or only nearly (another exponent, another servo).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mjfish.fish import Fish
from studies.battery.generator import foreign
from studies.battery.generator.causes import Cause, Draw


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _one(parameter: str, size: float, *, signed: bool = False) -> Draw:
    return lambda rng: {parameter: size * (_sign(rng) if signed else 1.0)}


def _current(rng: np.random.Generator) -> dict[str, float]:
    heading = rng.uniform(0.0, 2.0 * np.pi)
    return {"ambient_current.x": 0.005 * np.cos(heading), "ambient_current.y": 0.005 * np.sin(heading)}


def _roll(rng: np.random.Generator) -> dict[str, float]:
    shapes = {"roll.frequency": float(rng.uniform(5.0, 14.0)), "roll.damping": float(rng.uniform(0.1, 0.4))}
    return {"roll.height": 0.002 * _sign(rng), **shapes}


def _along_x(rng: np.random.Generator) -> dict[str, float]:
    return {"ambient_current.x": 0.005 * _sign(rng), "ambient_current.y": 0.0}


def _lag_and_offset(rng: np.random.Generator) -> dict[str, float]:
    """A servo that is late and a camera clock that is as much behind: no net phase at low frequency."""
    del rng
    return {"servo_lag.time_constant": 0.001, "time_offset.offset": 0.001}


def _reynolds(rng: np.random.Generator) -> dict[str, float]:
    share = rng.uniform(0.0, 1.0)
    return {"reynolds_drag.friction": 0.5 * share, "reynolds_drag.pressure": 0.2 * (1.0 - share)}


def _linear(rng: np.random.Generator) -> dict[str, float]:
    share = rng.uniform(0.0, 1.0)
    return {"linear_drag.along": 1.0 * share, "linear_drag.across": 20.0 * (1.0 - share)}


def _compliance(rng: np.random.Generator) -> dict[str, float]:
    return {"tail_compliance.compliance": 0.03, "tail_compliance.damping": float(rng.uniform(0.05, 0.18))}


def _plays(rng: np.random.Generator) -> dict[str, float]:
    """Return the same play of all joints, or of one."""
    worn = np.ones(4) if rng.integers(2) else np.eye(4)[rng.integers(4)]
    return {f"servo_backlash.joint_{i + 1}": 0.01 * float(one) for i, one in enumerate(worn)}


def _stick(rng: np.random.Generator) -> dict[str, float]:
    return {
        "sticking_joint.size": 0.3,
        "sticking_joint.joint": float(rng.integers(4)),
        "sticking_joint.seed": float(rng.integers(2**31)),
    }


def _tether(rng: np.random.Generator) -> dict[str, float]:
    x, y = rng.uniform(-1.0, 1.0, size=2)
    return {"tether.stiffness": 0.005, "tether.x": float(x), "tether.y": float(y)}


def _torque(rng: np.random.Generator) -> dict[str, float]:
    return {"heading_torque.size": 0.002, "heading_torque.yaw": float(rng.uniform(-np.pi, np.pi))}


def _zero(rng: np.random.Generator) -> dict[str, float]:
    bend = rng.standard_normal(4)
    return {f"joint_zero_offset.joint_{i + 1}": 0.01 * float(b) for i, b in enumerate(bend / np.linalg.norm(bend))}


def _marker(rng: np.random.Generator) -> dict[str, float]:
    angle = rng.uniform(0.0, 2.0 * np.pi)
    return {"marker_offset.along": 0.002 * np.cos(angle), "marker_offset.across": 0.002 * np.sin(angle)}


def _wake(rng: np.random.Generator) -> dict[str, float]:
    return {"wake_memory.share": 0.01, "wake_memory.time": float(rng.uniform(0.08, 0.3))}


def _wall(rng: np.random.Generator) -> dict[str, float]:
    """The walls themselves stand where the runs need them, see `studies.battery.generator.case`."""
    return {"wall_effect.size": 0.02, "wall_effect.reach": float(rng.uniform(0.1, 0.4))}


#: Walls of the tank [m].
WALLS = ("wall_effect.x0", "wall_effect.x1", "wall_effect.y0", "wall_effect.y1")

#: On the solver's list.
LISTED = (
    Cause("time_offset", _one("time_offset.offset", 0.001, signed=True), 0.0, 200.0),
    Cause("velocity_scale", _one("velocity_scale.error", 0.01, signed=True), 0.0, 30.0),
    Cause("frame_misalignment", _one("frame_misalignment.angle", 0.01, signed=True), 0.0, 50.0),
    Cause("marker_offset", _marker, 0.0, 50.0),
    Cause("servo_rate_limit", _one("servo_rate_limit.slowness", 0.1), 0.0, 5.0, exact=False),
    Cause("servo_saturation", _one("servo_saturation.psi", 0.05), 0.0, 200.0, exact=False),
    Cause("servo_backlash", _plays, 0.0, 30.0, exact=False),
    Cause("joint_zero_offset", _zero, 0.0, 30.0),
    Cause("servo_lag", _one("servo_lag.time_constant", 0.001), 0.5, 200.0, exact=False),
    Cause("ambient_current", _current, 0.0, 60.0, exact=False, needs_pose=True),
    Cause("reynolds_drag", _reynolds, 0.0, 30.0, exact=False),
    Cause("linear_drag", _linear, 0.0, 15.0),
    Cause("fin_lift", _one("fin_lift.slope", 0.3), 0.0, 25.0, exact=False),
    Cause("munk_moment", _one("munk_moment.kappa", 0.1, signed=True), 0.0, 10.0),
    Cause("tail_compliance", _compliance, 0.1, 40.0, shapes=("tail_compliance.damping",)),
    Cause("inertia_error", _one("inertia_error.error", 0.05, signed=True), 0.0, 11.0),
    Cause("com_offset", _one("com_offset.shift", 0.005, signed=True), 0.0, 15.0),
    Cause("roll", _roll, 0.0, 90.0, exact=False, shapes=("roll.frequency", "roll.damping")),
    Cause("wake_memory", _wake, 0.0, 90.0, exact=False, shapes=("wake_memory.time",)),
)
#: On the list, and invisible (mass) or all but invisible while all nine coefficients are free; not drawn.
GAUGES = (
    Cause("mass_error", _one("mass_error.error", 0.05, signed=True), 0.0, 10.0),
    Cause("section_height", _one("section_height.error", 0.05, signed=True), 0.0, 9.0),
)
#: Off it; walls too, for the datasets do not say where the tank ends.
OFF_LIST = (
    Cause("tether", _tether, 0.0, 200.0, listed=False, shapes=("tether.x", "tether.y"), needs_pose=True),
    Cause("fading_battery", _one("fading_battery.rate", 5e-5), 0.0, 100.0, listed=False),
    Cause("frequency_gain", _one("frequency_gain.size", 0.01), 0.0, 50.0, listed=False),
    Cause("heading_torque", _torque, 0.0, 200.0, listed=False, shapes=("heading_torque.yaw",), needs_pose=True),
    Cause("asymmetric_tail", _one("asymmetric_tail.size", 0.01, signed=True), 0.0, 200.0, listed=False),
    Cause("warming_water", _one("warming_water.rate", 3e-4), 0.0, 60.0, listed=False),
    Cause("run_order", _one("run_order.size", 0.005), 0.0, 200.0, listed=False),
    Cause(
        "sticking_joint",
        _stick,
        0.0,
        3.3,
        listed=False,
        shapes=("sticking_joint.joint", "sticking_joint.seed"),
    ),
    Cause(
        "wall_effect",
        _wall,
        0.0,
        90.0,
        listed=False,
        shapes=("wall_effect.reach", *WALLS),
        needs_pose=True,
    ),
    Cause("bad_run", _one("bad_run.size", 0.02), 0.0, 30.0, listed=False, shapes=("bad_run.number",)),
)
#: Causes that look like nothing, or like another: drawn like causes on the list.
DECOYS = (
    Cause("coefficient_at_bound", lambda rng: {}, 0.0, 1.0, listed=False),
    Cause("current_along_x", _along_x, 0.0, 60.0, exact=False, needs_pose=True),
    Cause("lag_and_offset", _lag_and_offset, 0.5, 200.0, exact=False),
)
#: Mechanisms of the list in forms that are not on it.
FOREIGN = foreign.FOREIGN
#: Domains that are right where they are stated, of causes off the list; none of others.
OFF_DOMAINS = {
    "fading_battery": ("drive",),
    "frequency_gain": ("drive",),
    "sticking_joint": ("drive",),
    "asymmetric_tail": ("water", "body"),
    "warming_water": ("water",),
    "run_order": ("water",),
    "wall_effect": ("water",),
}
CAUSES = {cause.name: cause for cause in (*LISTED, *GAUGES, *OFF_LIST, *DECOYS, *FOREIGN)}
#: Mechanisms by cause, of the list and of foreign forms.
MECHANISMS = {
    "time_offset": "clock",
    "velocity_scale": "camera_scale",
    "frame_misalignment": "camera_axes",
    "marker_offset": "tracked_point",
    "servo_rate_limit": "servo_dynamics",
    "servo_saturation": "servo_limit",
    "servo_backlash": "servo_play",
    "joint_zero_offset": "joint_zero",
    "servo_lag": "servo_dynamics",
    "ambient_current": "current",
    "reynolds_drag": "drag_law",
    "linear_drag": "drag_law",
    "fin_lift": "lift",
    "munk_moment": "reactive_force",
    "tail_compliance": "tail_flexibility",
    "inertia_error": "mass_distribution",
    "com_offset": "mass_distribution",
    "mass_error": "mass_distribution",
    "section_height": "added_mass",
    "roll": "roll",
    "wake_memory": "wake_memory",
    **{cause.name: mechanism for mechanism, forms in foreign.BY_MECHANISM.items() for cause in forms},
}


def water(fish: Fish, psi: Mapping[str, float]) -> dict[str, float]:
    """Return the numbers of the kernel that `psi` changes."""
    names = {
        "munk_moment.kappa": "kappa",
        "reynolds_drag.friction": "re_friction",
        "reynolds_drag.pressure": "re_pressure",
        "linear_drag.along": "linear_along",
        "linear_drag.across": "linear_across",
        "fin_lift.slope": "lift",
        "cubic_drag.size": "cubic",
        "tether.stiffness": "tether",
        "heading_torque.size": "torque",
        "heading_torque.yaw": "torque_yaw",
        "warming_water.rate": "viscosity",
        "wake_memory.share": "memory",
        "wake_memory.time": "memory_time",
        "wall_effect.size": "wall",
        "wall_effect.reach": "wall_length",
    }
    given = {ours: psi[key] for key, ours in names.items() if key in psi}
    given |= foreign.water(psi)
    given["kappa"] = given.get("kappa", 0.0) + fish.munk_moment
    if "tether.x" in psi:  # the kernel's world is half a turn from the tank's
        given |= {"tether_x": -psi["tether.x"], "tether_y": -psi["tether.y"]}
    if "wall_effect.x0" in psi:
        x0, x1, y0, y1 = (-psi[wall] for wall in WALLS)
        given |= {"wall_x0": x1, "wall_x1": x0, "wall_y0": y1, "wall_y1": y0}
    if psi.get("tail_compliance.compliance"):
        given |= {"stiffness": 1.0 / psi["tail_compliance.compliance"], "damping": psi["tail_compliance.damping"]}
    if "asymmetric_tail.size" in psi:
        last = fish.sections[-1]
        area = 0.5 * sum(last.height) * (last.end - last.start)
        given["tail_side"] = 0.5 * fish.density * area * psi["asymmetric_tail.size"]
    return given
