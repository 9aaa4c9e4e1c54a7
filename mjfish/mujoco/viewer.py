"""The fish in MuJoCo's own viewer, the water on, with sliders for its drive and its coefficients.

The viewer has a slider for every actuator (panel Control). Beside the servos, which the drive moves, the model has
actuators that push with nothing: their sliders are read before every picture. Arrows are the force of the water on
each link, which stands in `xfrc_applied` whole with the coupling "xfrc"; MuJoCo draws them, and its key B hides them.
"""

from __future__ import annotations

import os
import sys
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from mjfish.drive.motion import JointMotion
from mjfish.errors import InputError
from mjfish.fish import KINDS, Fish
from mjfish.hydro.load import Load, memory_of
from mjfish.mujoco import mjcf
from mjfish.mujoco.fluid import StripFluid
from mjfish.mujoco.layout import compile_aside
from mjfish.mujoco.links import StripLink
from mjfish.mujoco.memory import make_room
from mjfish.mujoco.mjcf import Trim
from mjfish.numerics.arrays import FloatArray

#: Time step [s], and pictures a second.
_STEP, _RATE = 0.002, 50.0
#: Sliders of the drive: lowest, first and highest value.
DRIVE = {"pace": (0.0, 1.0, 2.0), "swing": (0.0, 1.0, 2.0), "turn": (-0.4, 0.0, 0.4)}


@dataclass(frozen=True, eq=False)
class Player:
    """Joint angles without end: a motion, then its last beat over and over.

    Attributes:
        motion: of the joints, from 0 on.
        beat: what is repeated at its end [s].
    """

    motion: JointMotion
    beat: float

    def angle(self, clock: float) -> FloatArray:
        """Return the angles (joints,) [rad] at a time [s] of the drive."""
        end = float(self.motion.time[-1])
        if clock > end:
            clock = end - self.beat + (clock - end) % self.beat
        return np.asarray(self.motion.angle_at(np.array([clock]))[0])


class Tank:
    """A fish with its drive in water, whose drive and coefficients follow sliders.

    ``pace`` is the speed of the drive, ``swing`` a factor of its angles, ``turn`` is added to every joint [rad]; the
    others are the fish's coefficients, within their bounds.

    Args:
        fish: the fish.
        player: of its joint angles.
        values: coefficients by name that replace the fish's.
        free: None: in the plane; else free in space, trimmed like that.
        loads: extra forces on every link, with their parameters.

    Attributes:
        model, data: of MuJoCo.
        water: on the model; its coefficients follow the sliders.
        length: of the fish [m].
        sliders: index of each slider in `data.ctrl`, by name.
    """

    def __init__(
        self,
        fish: Fish,
        player: Player,
        *,
        values: Mapping[str, float] | None = None,
        free: Trim | None = None,
        loads: Sequence[tuple[Load, Sequence[float]]] = (),
    ) -> None:
        self._fish, self._player, self._free = fish, player, free
        self.length = fish.length
        first = {**fish.values, **(values or {})}
        ranges = DRIVE | {
            p.name: (min(p.low, first[p.name]), first[p.name], max(p.high, first[p.name])) for p in fish.parameters
        }
        spec = mjcf.prepared(fish, mjcf.spec(fish, free), _STEP, "RK4")
        spec.nuserdata = 0  # the servos read ctrl
        spec.visual.map.force = 0.03 * fish.length  # an arrow is a third of the fish long at 10 m/s2 of the mean link
        servos = len(spec.actuators)
        for name, (low, _, high) in ranges.items():
            slider = spec.add_actuator(
                name=name,
                target="joint_1",
                trntype=mujoco.mjtTrn.mjTRN_JOINT,
                gaintype=mujoco.mjtGain.mjGAIN_FIXED,
                biastype=mujoco.mjtBias.mjBIAS_NONE,
                ctrllimited=mujoco.mjtLimited.mjLIMITED_TRUE,
                ctrlrange=(low, high),
            )
            slider.gainprm[0] = 0.0
        make_room(spec, memory_of(loads, len(fish.links)))
        self.model = compile_aside(spec)
        self.data = mujoco.MjData(self.model)
        self.sliders = {name: servos + k for k, name in enumerate(ranges)}
        self.data.ctrl[[*self.sliders.values()]] = [value for _, value, _ in ranges.values()]
        self._servos = slice(0, servos)
        self._clock = 0.0
        self.water = StripFluid(self.model, self._strips(), density=fish.density, coupling="xfrc", loads=loads)

    def _strips(self) -> tuple[StripLink, ...]:
        """Return the links with the coefficients that the sliders show."""
        shown = {name: float(self.data.ctrl[self.sliders[name]]) for name in self._fish.coefficient_names}
        return mjcf.strips(self._fish, shown, self._free)

    def advance(self, duration: float) -> None:
        """Swim on for a while [s], as the sliders say; call it while the water is installed.

        A run that diverges begins anew, at rest where the fish is not.
        """
        strips = self._strips()
        self.water.set(**{kind: [getattr(strip, kind) for strip in strips] for kind in KINDS})
        pace, swing, turn = (float(self.data.ctrl[self.sliders[name]]) for name in DRIVE)
        for _ in range(max(1, round(duration / _STEP))):
            self.data.ctrl[self._servos] = swing * self._player.angle(self._clock) + turn
            mujoco.mj_step(self.model, self.data)
            self._clock += pace * _STEP
        if self.water.state(self.data).status != "ok":
            controls = self.data.ctrl.copy()
            mujoco.mj_resetData(self.model, self.data)
            self.data.ctrl[:] = np.nan_to_num(controls)


def show(tank: Tank) -> None:
    """Open the viewer and swim in real time until it is closed.

    Raises:
        InputError: there is no display.
    """
    check_display()
    from mujoco import viewer  # needs a display where it is imported, on some systems

    with tank.water.installed():
        try:
            handle = viewer.launch_passive(tank.model, tank.data)
        except RuntimeError as error:
            raise InputError(f"--viewer: {error}; on macOS run it by mjpython") from None
        with handle:
            swim(tank, handle)


def swim(tank: Tank, handle: Any) -> None:
    """Swim in real time while a viewer is open; its camera follows the head.

    Args:
        tank: the fish in water.
        handle: of MuJoCo on the viewer.
    """
    with handle.lock():
        handle.cam.type, handle.cam.trackbodyid = mujoco.mjtCamera.mjCAMERA_TRACKING.value, 1
        handle.opt.flags[mujoco.mjtVisFlag.mjVIS_PERTFORCE] = True
        handle.cam.distance, handle.cam.azimuth, handle.cam.elevation = 2.5 * tank.length, 90.0, -50.0
    while handle.is_running():
        started = time.monotonic()
        with handle.lock():
            tank.advance(1.0 / _RATE)
        handle.sync()
        time.sleep(max(0.0, 1.0 / _RATE - (time.monotonic() - started)))


def check_display() -> None:
    """Refuse to open a window where there is no display.

    Raises:
        InputError: see above.
    """
    missing = sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
    if not missing:
        import glfw

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # glfw warns of what is told here
            missing = not glfw.init()
    if missing:
        raise InputError(
            "--viewer: there is no display to open a window on; run it where there is one (DISPLAY is not set or not "
            "reachable), or write a film: mjfish render"
        )
