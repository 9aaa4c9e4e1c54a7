"""Memory of the water learned from the data: drag and added momentum that follow the motion by two lags."""

from __future__ import annotations

from typing import Any

import numpy as np

from mjfish.effects.effect import Effect, Fingerprint, Values
from mjfish.hydro.force import crossflow
from mjfish.hydro.load import load
from mjfish.parameters import Parameter
from mjfish.parameters.prior import Prior


@load(memory=8)
def _late(link: Any, parameters: Any) -> tuple[float, ...]:
    """Return what the lags make of the force across, and the rates of the lagged drag and momentum."""
    drag_share, late_drag_share = parameters[0], parameters[1]
    mass_share, late_mass_share = parameters[2], parameters[3]
    time, late_time = parameters[4], parameters[5]
    force, moment = crossflow(link.v, link.w, link.length, link.node_height, link.height_moment)
    across = -0.5 * link.density * link.c_d
    force, moment = across * force, across * moment
    momentum = link.c_m * (link.added[0] * link.v + link.added[1] * link.w)
    turning = link.c_m * (link.added[1] * link.v + link.added[2] * link.w)
    f1, f2 = force - link.memory[0], force - link.memory[1]
    m1, m2 = moment - link.memory[2], moment - link.memory[3]
    p1, p2 = (momentum - link.memory[4]) / time, (momentum - link.memory[5]) / late_time
    t1, t2 = (turning - link.memory[6]) / time, (turning - link.memory[7]) / late_time
    return (
        0.0,
        -drag_share * f1 - late_drag_share * f2 - mass_share * p1 - late_mass_share * p2,
        -drag_share * m1 - late_drag_share * m2 - mass_share * t1 - late_mass_share * t2,
        f1 / time,
        f2 / late_time,
        m1 / time,
        m2 / late_time,
        p1,
        p2,
        t1,
        t2,
    )


class WakeKernel(Effect):
    """Drag across and added momentum follow the motion by a kernel of two exponentials, learned.

        F' = F + psi_1 (F_1 - F) + psi_2 (F_2 - F) - chi_1 p_1' - chi_2 p_2'
        tau_i F_i' = F - F_i,   tau_i p_i' = p - p_i,   F_i = p_i = 0 where the run begins

    F is force and moment of the drag across a link, p its added momentum and the moment of it. After a sudden start the
    drag comes as 1 - psi_1 exp(-t / tau_1) - psi_2 exp(-t / tau_2), and the added momentum grows by the shares chi in
    the same times. One share alone is `WakeMemory` or `AddedMassMemory`. Wagner's function has two such lags.
    """

    name, domain, mechanism = "wake_kernel", "water", "wake_memory"
    learned = True
    summary = "drag and added mass follow the motion late, learned"
    parameters = (
        Parameter("wake_kernel.drag", "-", 0.0, -1.0, 1.0, 0.0, 0.05, about="psi_1, of the drag"),
        Parameter("wake_kernel.late_drag", "-", 0.0, -1.0, 1.0, 0.0, 0.05, about="psi_2, of the drag"),
        Parameter("wake_kernel.mass", "-", 0.0, -1.0, 2.0, 0.0, 0.2, about="chi_1, of the added mass"),
        Parameter("wake_kernel.late_mass", "-", 0.0, -1.0, 2.0, 0.0, 0.2, about="chi_2, of the added mass"),
        Parameter("wake_kernel.time", "s", 0.06, 0.02, 0.2, 0.06, 0.02, about="tau_1, of the early lag", shape=True),
        Parameter("wake_kernel.late_time", "s", 0.4, 0.1, 1.5, 0.4, 0.1, about="tau_2, of the late lag", shape=True),
    )
    source = "Jones, NACA Report 681 (1940): Wagner's function as two exponentials; Cummins, Schiffstechnik 9 (1962)"
    signature = "sway and yaw rate of the beat have another phase, by frequency; starts and turns overshoot"
    confirm = "hold the fish, step one joint and watch the side force settle after the joint has stopped"
    fingerprint = Fingerprint(exponent=None, odd=False, part="everywhere")
    resembles = ("design-no-start",)
    load = _late

    def like(self, formula: str, values: Values) -> dict[str, float]:
        """Return the kernel at the numbers of a formula: the lag whose times reach its own."""
        kind = {"wake_memory": "drag", "added_mass_memory": "mass"}.get(formula)
        if kind is None:
            return {}
        times = {short: self.declaration(short) for short in ("time", "late_time")}
        lag = "time" if values["time"] <= times["time"].high else "late_time"
        return {
            kind if lag == "time" else f"late_{kind}": values["share"],
            lag: float(np.clip(values["time"], times[lag].low, times[lag].high)),
        }

    def priors(self) -> tuple[Prior, ...]:
        """Shares are less than one."""
        return (
            Prior("wake_kernel.drag", ("wake_kernel.drag", "wake_kernel.late_drag"), np.eye(2), 0.5),
            Prior("wake_kernel.mass", ("wake_kernel.mass", "wake_kernel.late_mass"), np.eye(2), 1.0),
        )
