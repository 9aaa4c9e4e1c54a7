"""The plug-in: strips of water on bodies of any MuJoCo model."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from numbers import Real
from pathlib import Path
from typing import Any, Literal

import mujoco
import numpy as np
from numba import carray
from numpy.typing import ArrayLike

from mjfish.errors import InputError, UnknownNameError
from mjfish.errors.arguments import check as check_type
from mjfish.hydro.load import PARAMETERS, Load, memory_of
from mjfish.mujoco import callback, custom_numerics
from mjfish.mujoco.block import MAGIC, Block, block_of, view
from mjfish.mujoco.coupling_choice import Checked, Coupling, choose
from mjfish.mujoco.layout import data_at, floats, model_at, verify
from mjfish.mujoco.link_force import (
    FRAME,
    add_loads,
    add_wrench,
    fill_accelerations,
    fill_frame,
    load_scratch,
    non_inertial,
    take_inertial,
    to_world,
)
from mjfish.mujoco.links import DENSEST, BluntLink, Link, StripLink, link_of, read, with_coefficients
from mjfish.mujoco.memory import room_in
from mjfish.numerics.arrays import FloatArray, readonly
from mjfish.numerics.compiled import compiled

#: Parts of the force on a link, in the order of the arrays.
PARTS = ("drag", "added_mass", "munk", "buoyancy", "loads")
#: A link this many times as long as half of the model is warned of.
_LARGER = 20.0


@dataclass(frozen=True)
class State:
    """Whether the state of a run is one that can be gone on from.

    Attributes:
        status: ``ok`` or ``diverged``.
        message: what is wrong and what to do, else empty.
    """

    status: Literal["ok", "diverged"]
    message: str


class StripFluid:
    """Water on bodies of a MuJoCo model, exact at any added mass.

    With M, c, tau MuJoCo's inertia, bias and other forces, J_i the Jacobian of link i, A_i its added mass, f_i its
    drag, gyroscopic force, Munk moment and buoyancy, and b_i its acceleration at zero joint acceleration, the
    acceleration a is the solution of

        (M + sum_i J_i^T A_i J_i) a = tau - c + sum_i J_i^T (f_i - A_i b_i)

    in the same step, not one step late (`mjfish.mujoco.coupling`). A_i and f_i are integrals of the Morison force over
    the strips of a link, with the Munk moment of [Lamb, art. 124] (`mjfish.hydro.spatial_force`).

    The water owns `xfrc_applied` of its bodies: push these by `qfrc_applied`. A current is MuJoCo's `opt.wind`, which
    `current` writes; gravity and its flag are MuJoCo's too, and buoyancy follows them. The water is part of the model
    from now on: of its copies, in `mujoco.rollout`, `mujoco.batch` and the viewer, in every thread. A second
    `StripFluid` on a model replaces the first; other coefficients on a copy of a model leave the original alone.

    A model compiled anew, by `MjSpec.compile` or `recompile`, has none: put it there again.

    Two things in the model change, and `opt.wind` with a `current`: `opt.o_solimp`, which is unused, leads to the
    water, and autoreset is disabled, so that a run which diverges is seen (`state`) and not silently started again.

    With coupling ``inertia`` mjData's inertia `M` (and what is computed from it, such as `mj_fullM`) has the added mass
    in it after a step, and force sensors lack the inertial force of the water; with ``xfrc`` both are as without water.

    Attributes:
        model: the model.
        links: `StripLink` or `BluntLink` by link, in the order of every array about links; `set` changes their
            coefficients.
        density: of the water [kg/m3].
        coupling: ``inertia`` or ``xfrc``, see `mjfish.mujoco.coupling`.

    Raises:
        InputError: a link is not described well, or the force would be wrong in this model; with the remedy.
        UnknownNameError: the model has no body of that name.

    Example:
        >>> import mujoco
        >>> model = mujoco.MjModel.from_xml_string('''
        ... <mujoco><option gravity="0 0 0"/><worldbody><body name="plate"><joint type="slide" axis="0 1 0"/>
        ... <geom type="box" size=".15 .002 .1" pos="-.15 0 0" density="2000"/></body></worldbody></mujoco>''')
        >>> link = mjfish.StripLink(body="plate", length=0.3, height=0.2, width=0.004, c_d=1.9)
        >>> fluid = mjfish.StripFluid(model, [link])
        >>> data = mujoco.MjData(model)
        >>> data.qvel[0] = 1.0
        >>> with fluid.installed():
        ...     mujoco.mj_forward(model, data)
        >>> fluid.wrenches(data)["drag"].shape
        (1, 6)
        >>> print(f"{fluid.wrenches(data)['drag'][0, 1]:.1f} N")  # 1/2 rho c_d h L v^2
        -57.0 N
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        links: Sequence[Link | Mapping[str, Any]] | None = None,
        *,
        density: float | None = None,
        current: Sequence[float] | FloatArray | None = None,
        coupling: Coupling | None = None,
        commanded: bool = False,
        loads: Sequence[tuple[Load, Sequence[float]]] = (),
    ) -> None:
        """Put water on bodies of `model`.

        Args:
            model: any model.
            links: bodies with their sections and coefficients; None: as the model's custom numerics say
                (``strip_fluid/BODY/KEY``). Two links may share a body.
            density: of the water [kg/m3]; 1000 where nobody says.
            current: velocity of the water (3,) in the world [m/s], uniform and steady; None: that in `opt.wind`.
            coupling: None: the one that is right for this model, ``inertia`` where both are.
            commanded: userdata holds the servo commands of each step, see `mjfish.mujoco.rollout`.
            loads: extra forces on every link (`mjfish.hydro.load`), with their parameters; they see the motion of a
                link in the plane of its strips' x and y, and push in it. The last of the links is their last. They may
                read x, y of the strips' origin in the world, the heading, from the world's x to where stations fall
                (-pi to pi, about its z), and the bend, the heading less that of the first link. Hidden states need
                room in the model, see `mjfish.mujoco.memory`.

        Raises:
            InputError: a link is not described well, the force would be wrong in this model, or there is no room in it
                for the hidden states of loads.
            UnknownNameError: no body of that name.
        """
        _check_compiled(model)
        check_type("commanded", commanded, bool)
        if links is None:
            water = custom_numerics.read(model)
            links, density = water.links, water.density if density is None else density
        self.model = model
        self.links = _links(links)
        density = 1000.0 if density is None else density
        if isinstance(density, bool) or not isinstance(density, Real) or not 0.0 < density <= DENSEST:
            raise InputError(
                f"density: found {density!r}, expected a number above 0 and at most {DENSEST:g} kg/m3; correct it"
            )
        self.density: float = float(density)
        _check_loads(loads, self.links)
        room = room_in(model, memory_of(loads, len(self.links)))
        self._states: int = room.states
        numbers = 1 + 3 * (room.control if room.states else model.nu)
        if commanded and model.nuserdata != numbers:
            raise InputError(
                f"userdata: found {model.nuserdata} numbers, expected {numbers} for the commands; set "
                f'<size nuserdata="{numbers}"/>'
            )
        bodies = _bodies(model, self.links)
        for link in self.links if model.ngeom else ():  # one without geoms has no size
            if isinstance(link, StripLink) and link.length > _LARGER * model.stat.extent:  # as in other units
                warnings.warn(
                    f"link '{link.body}' is {link.length:g} m long, the whole model {2.0 * model.stat.extent:.2g} m; "
                    "give lengths in m, or correct the extent of the model (<statistic extent>)",
                    stacklevel=2,
                )
        chosen: Coupling = choose(model, bodies, coupling)
        self.coupling: Coupling = chosen
        _set_current(model, current)
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        self._block: Block = Block(
            model, self.links, self.density, inertia=chosen == "inertia", commanded=commanded, loads=loads
        )
        self._block.tag(model)

        def check() -> None:
            choose(model, bodies, chosen)
            room_in(model, room.states)

        self._checked: Checked = Checked(model, check)

    def __repr__(self) -> str:
        """Return density, bodies and coupling."""
        bodies = ", ".join(dict.fromkeys(link.body for link in self.links))
        return f"<StripFluid of {self.density:g} kg/m3 on {bodies}; coupling {self.coupling}>"

    @classmethod
    def from_toml(
        cls,
        model: mujoco.MjModel,
        path: str | Path,
        *,
        current: Sequence[float] | FloatArray | None = None,
        coupling: Coupling | None = None,
    ) -> StripFluid:
        """Put the water that a TOML file describes on bodies of `model`: `density`, and a `[[links]]` a body.

        Raises:
            InputError, UnknownNameError: as above, and where the file is none.
        """
        _check_compiled(model)
        check_type("path", path, str | Path)
        water = read(path)
        _bodies(model, water.links, f"body in {path}")
        return cls(model, water.links, density=water.density, current=current, coupling=coupling)

    @contextmanager
    def installed(self) -> Iterator[None]:
        """Let the water act while the block runs, on this model, its copies, and all others with water.

        Blocks may be nested and overlap. A control callback of your own that was installed before is called first;
        afterwards all is as it was. Do not install one inside the block: it would replace the water. Behind the last
        block the force of the water is taken out of every mjData again: on its bodies, `xfrc_applied` is what it was
        before, and the rates of hidden states in `ctrl` are zero. `mujoco.batch` copies these fields into arrays of its
        own: set ``batch.xfrc_applied[:] = 0`` there, and the rates.

        Warns, once, of steps that an mjData took since the block before: they were without water.

        Raises:
            InputError: the model was changed so that the force would now be wrong, or given other water.
        """
        self._still_there()
        self._checked.again()
        with callback.installed():
            yield

    def _still_there(self) -> None:
        if self.model.opt.o_solimp[0] != MAGIC:
            raise InputError(
                "opt.o_solimp: found another value than the tag of the water; put a new StripFluid on the model, and "
                "leave it alone"
            )
        if block_of(self.model) is not self._block:
            raise InputError(
                "another StripFluid has taken the place of this one on the model; use that one, with the links of both"
            )

    def set(self, **coefficients: ArrayLike) -> None:
        """Set coefficients of the links, in this model and in its copies; the next step has them, inside a block too.

        The water is then, to the last bit, that of a new `StripFluid` with these coefficients, and `links` has them.
        Call it while no other thread steps the model. Other coefficients for a copy need a `StripFluid` of its own.

        Args:
            coefficients: ``c_m``, ``c_d``, ``c_f``, ``munk_moment``, ``roll_damping``: a number for all links, or one
                a link, in the order of `links`; what is not given stays. A `BluntLink` has the first two and the Munk
                moment; it passes others over.

        Raises:
            UnknownNameError: no such coefficient.
            InputError: a value is no number or outside its bounds, there are not as many as links, or another
                StripFluid has taken the place of this one. Nothing is set then.

        Example:
            >>> import mujoco
            >>> model = mujoco.MjModel.from_xml_string('<mujoco><worldbody><body name="plate">'
            ...     '<joint type="slide"/><geom size=".1"/></body></worldbody></mujoco>')
            >>> fluid = mjfish.StripFluid(model, [{"body": "plate", "length": 0.3, "height": 0.2, "width": 0.004}])
            >>> fluid.set(c_d=1.9, c_m=[0.8])
            >>> fluid.links[0].c_d, fluid.links[0].c_m
            (1.9, 0.8)
        """
        self._still_there()
        links = with_coefficients(self.links, coefficients)
        self._block.set_coefficients(links)
        self.links = links

    def wrenches(self, data: mujoco.MjData) -> dict[str, FloatArray]:
        """Return the force of the water on each link by part, at the state and acceleration that `data` is in.

        Call it after `mj_forward`: behind a step of RK4 mjData still speaks of the last stage.

        Returns:
            ``drag``, ``added_mass`` (inertial and gyroscopic), ``munk``, ``buoyancy``, ``loads``, ``total``: (links, 6)
            each, force [N] and moment about the body's centre of mass [N m] in the world's axes, as in `xfrc_applied`.

        Raises:
            InputError: another StripFluid has taken the place of this one.
        """
        self._still_there()
        verify()
        parts = np.zeros((len(PARTS), len(self.links), 6))
        _fill_parts(self.model._address, data._address, self._block.header.ctypes.data, parts)
        return dict(zip((*PARTS, "total"), map(readonly, (*parts, parts.sum(axis=0))), strict=True))

    def state(self, data: mujoco.MjData) -> State:
        """Return whether a run has diverged: no numbers or huge ones in the state or its rate."""
        kinds = mujoco.mjtWarning
        bad = [kinds.mjWARN_BADQPOS, kinds.mjWARN_BADQVEL, kinds.mjWARN_BADQACC]
        bad += [kinds.mjWARN_BADCTRL] if self._states else []  # rates of hidden states stand in ctrl
        warned = any(data.warning[kind].number for kind in bad)
        if not warned and all(np.all(np.isfinite(part)) for part in (data.qpos, data.qvel, data.qacc)):
            return State("ok", "")
        found = f"the state is no longer one of numbers at {data.time:.4f} s"
        try:
            _check_water(data.model)
        except InputError as error:
            return State("diverged", f"{found}: {error}")
        return State("diverged", f"{found}; take a shorter step, softer actuators, or check the coefficients")


@compiled
def _fill_parts(model_address: int, data_address: int, block_address: int, parts: FloatArray) -> None:
    """Fill the parts (len(PARTS), links, 6) of the force on each link, as in `xfrc_applied`."""
    model = carray(model_at(model_address), 1)[0]
    data = carray(data_at(data_address), 1)[0]
    water = view(block_address)
    acceleration = np.empty((water.carriers.shape[0], 6))
    fill_accelerations(data, water.carriers, carray(floats(data.qacc), model.nv), acceleration)
    frame = np.empty(FRAME)
    scratch = load_scratch(data, water, np.empty(water.head[0].states))
    spatial = np.empty(6)
    for i in range(water.links.shape[0]):
        link = water.links[i]
        wrench = np.zeros((len(PARTS), 6))
        fill_frame(model, data, link, frame)
        drag, gyroscopic, munk, lift = non_inertial(model, data, link, frame)
        wrench[0] = np.array(drag)
        wrench[1] = np.array(gyroscopic)
        take_inertial(model, data, link, frame, acceleration[int(link.carrier)], wrench[1])
        wrench[2, 3:] = np.array(munk)
        wrench[3] = np.array(lift)
        if water.loads.addresses.shape[0] > 0:
            add_loads(model, data, water, i, frame, scratch, wrench[4])
        for part in range(len(PARTS)):
            to_world(wrench[part], frame, spatial)
            add_wrench(model, data, int(link.body), spatial, parts[part, i])


def _check_water(model: mujoco.MjModel) -> None:
    """Raise InputError where a model has no water, or not its own, or its force is wrong in it."""
    water = block_of(model)
    head = water.header[0]
    sizes = (head["bodies"], head["dofs"], head["actuators"], head["activations"])
    if sizes != (model.nbody, model.nv, model.nu, model.na):
        raise InputError("opt.o_solimp is that of another model; call StripFluid(model, links) on this one")
    choose(model, water.links["body"].astype(int).tolist(), "inertia" if head["inertia"] else "xfrc")


def _check_loads(loads: Sequence[tuple[Load, Sequence[float]]], links: Iterable[Link]) -> None:
    check_type("loads", loads, Sequence[tuple[Any, Sequence[Any]]])
    blunt = [link.body for link in links if isinstance(link, BluntLink)]
    if loads and blunt:
        raise InputError(
            f"loads act on strips, which '{blunt[0]}' has none of; drop the loads, or describe it by strips"
        )
    for number, (load, parameters) in enumerate(loads, start=1):
        if not isinstance(load, Load):
            raise InputError(
                f"loads.{number}: expected a compiled Load, found {load!r}; write @mjfish.hydro.load.load above it"
            )
        if len(parameters) > PARAMETERS:
            raise InputError(
                f"loads.{number}: found {len(parameters)} parameters, expected {PARAMETERS} at most; drop some"
            )
        for value in parameters:
            if not isinstance(value, Real) or not np.isfinite(float(value)):
                raise InputError(f"loads.{number}: found the parameter {value!r}, expected a finite number; correct it")


def _set_current(model: mujoco.MjModel, current: Sequence[float] | FloatArray | None) -> None:
    current = model.opt.wind if current is None else current
    check_type("current", current, Sequence[float] | FloatArray)
    if np.shape(current) != (3,) or not np.all(np.isfinite(current)):
        raise InputError(
            f"current: found {np.array(current).tolist()}, expected three finite numbers, x, y, z [m/s]; correct it"
        )
    model.opt.wind[:] = current


def _check_compiled(model: object) -> None:
    if not isinstance(model, mujoco.MjModel):
        raise InputError(f"model: found a {type(model).__name__}, expected a compiled mujoco.MjModel; compile it")


def _bodies(model: mujoco.MjModel, links: Iterable[Link], kind: str = "body") -> list[int]:
    """Return the ids of the bodies; `kind` says of an unknown one what it is."""
    ids = {model.body(index).name: index for index in range(1, model.nbody)}
    for link in links:
        if link.body not in ids:
            raise UnknownNameError(kind, link.body, filter(None, ids), "name a body of this model")
    return [ids[link.body] for link in links]


def _links(links: Sequence[Link | Mapping[str, Any]]) -> tuple[Link, ...]:
    if isinstance(links, (str, Mapping, StripLink, BluntLink)) or not isinstance(links, Iterable):
        raise InputError(f"links: found a {type(links).__name__}, expected a list of links; put it into brackets")
    links = tuple(links)
    if not links:
        raise InputError("links: found none, expected one at least; name a body that the water acts on")
    for number, link in enumerate(links, start=1):
        if not isinstance(link, (StripLink, BluntLink, Mapping)):
            raise InputError(f"links.{number}: found {link!r}, expected a link or a table of its keys; correct it")
    return tuple(link_of(link) if isinstance(link, Mapping) else link for link in links)
