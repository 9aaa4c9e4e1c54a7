"""A fish as an MJCF that `mujoco` loads, with its water in custom numerics (`mjfish.mujoco.custom_numerics`).

    model = mujoco.MjModel.from_xml_path("fish.xml")
    fluid = mjfish.StripFluid(model)  # the water acts where this is installed

swims as `mjfish.mujoco.mjcf.swimmer` of the fish does, but for its servos, which read `data.ctrl` as any model's do.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path
from xml.etree import ElementTree as ET
from xml.sax.saxutils import quoteattr

import mujoco
import numpy as np

from mjfish.files import writing
from mjfish.fish import Fish
from mjfish.mujoco import mjcf
from mjfish.mujoco.custom_numerics import IDENTIFIED, PROFILES, ROW, numerics_of
from mjfish.mujoco.layout import compile_aside
from mjfish.mujoco.mjcf import Integrator, Trim
from mjfish.numerics.arrays import FloatArray

_END = "</mujoco>"
_HOW = (
    "The water is in the custom numerics at the end: MuJoCo keeps them and does nothing with them. In Python:",
    "  model = mujoco.MjModel.from_xml_path(...); fluid = mjfish.StripFluid(model)",
    "  with fluid.installed(): mujoco.mj_step(model, data)",
)
_ROWS = (
    "Rows of sections: from, to [m from the nose], height there and there, width there and there [m], profile",
    f"({', '.join(f'{number} {name}' for number, name in enumerate(PROFILES))}).",
)


def write(
    path: str | Path,
    fish: Fish,
    *,
    free: Trim | None = None,
    step: float = 0.001,
    integrator: Integrator = "RK4",
    comments: Sequence[str] = (),
) -> None:
    """Write the fish with its coefficients to an MJCF, whole or not at all; arguments as in `text`.

    Raises:
        InputError: another suffix than ``.xml``, the file cannot be written, or MuJoCo cannot have such a fish.
    """
    path = Path(path)
    writing.check_suffix(path, ".xml")
    writing.write_text(path, text(fish, free=free, step=step, integrator=integrator, comments=comments))


def text(
    fish: Fish,
    *,
    free: Trim | None = None,
    step: float = 0.001,
    integrator: Integrator = "RK4",
    comments: Sequence[str] = (),
) -> str:
    """Return the MJCF of the fish with its coefficients, every number to the last bit.

    Args:
        fish: the fish.
        free: None: it swims in the plane; else it is free in space, trimmed like that.
        step: time step [s].
        integrator: of MuJoCo.
        comments: lines at the top, such as where the numbers come from.

    Raises:
        InputError, UnknownNameError: MuJoCo cannot have such a fish.
    """
    spec = mjcf.prepared(fish, mjcf.spec(fish, free), step, integrator)
    spec.nuserdata = 0  # no commands: the servos read ctrl
    by_hand = mjcf.hand_written(fish, free=free is not None)
    if by_hand is None:
        compile_aside(spec)  # MuJoCo writes only what it has compiled
        root = ET.fromstring(spec.to_xml())  # noqa: S314 - written by MuJoCo just now
        _sharpen(root, spec)
        ET.indent(root)
    else:
        # with its inner comments; the one ahead speaks of a file without water
        root = ET.fromstring(by_hand, ET.XMLParser(target=ET.TreeBuilder(insert_comments=True)))  # noqa: S314 - our own
    _set(root, spec, fish)
    body = ET.tostring(root, encoding="unicode").replace(" />", "/>").strip().removesuffix(_END).rstrip()
    water = _custom(numerics_of(mjcf.strips(fish, free=free), fish.density), fish)
    return "\n".join([_comment([*comments, *_HOW]), body, "", *water, _END, ""])


def _set(root: ET.Element, spec: mujoco.MjSpec, fish: Fish) -> None:
    """Set what the hand-written file leaves open: step, integrator, heights of the centres of mass."""
    option = root.find("option")
    if option is None:
        option = ET.SubElement(root, "option")
    option.set("timestep", _number(spec.option.timestep))
    option.set("integrator", next(name for name, kind in mjcf.INTEGRATORS.items() if kind == spec.option.integrator))
    for link in fish.links:
        body = next(element for element in root.iter("body") if element.get("name") == link.name)
        for inertial in body.iterfind("inertial"):
            inertial.set("pos", _row(spec.body(link.name).ipos))


def _sharpen(root: ET.Element, spec: mujoco.MjSpec) -> None:
    """Give every number of the chain all its digits, MuJoCo writes six; name its servos what they are."""
    for element in root.iter("body"):
        body = spec.body(element.get("name"))
        if element.get("pos") is not None:
            element.set("pos", _row(body.pos))
        for inertial in element.iterfind("inertial"):
            inertial.set("mass", _number(body.mass))
            inertial.set("diaginertia", _row(body.inertia))
        for joint in element.iterfind("joint"):
            built = spec.joint(joint.get("name"))
            for name, values in (("stiffness", built.stiffness), ("damping", built.damping)):
                if any(values):
                    joint.set(name, _row(np.trim_zeros(values, "b")))
            if built.armature > 0.0:
                joint.set("armature", _number(built.armature))
    for spring in root.iterfind("tendon/fixed"):
        spring.set("stiffness", _row(np.trim_zeros(spec.tendon(spring.get("name")).stiffness, "b")))
    actuators = root.find("actuator")
    for servo in list(actuators if actuators is not None else ()):
        actuator = spec.actuator(servo.get("name"))
        stiffness, damping = _number(actuator.gainprm[0]), _number(-actuator.biasprm[2])
        servo.clear()
        servo.tag = "position"
        servo.attrib.update({"name": actuator.name, "joint": actuator.target, "kp": stiffness, "kv": damping})


def _custom(numerics: dict[str, tuple[float, ...]], fish: Fish) -> Iterator[str]:
    """Yield the lines of the custom numerics, a paragraph a body, sections row by row; then what was identified."""
    yield "  <custom>"
    yield "    " + _comment(_ROWS, "    ")
    for _, block in groupby(numerics, key=lambda name: name.rpartition("/")[0]):
        yield ""
        yield from (f"    <numeric name={quoteattr(name)} data={_data(name, numerics[name])}/>" for name in block)
    if fish.identified is not None:
        yield f"\n    <text name={quoteattr(IDENTIFIED)} data={quoteattr(fish.identified.model_dump_json())}/>"
    yield "  </custom>"


def _data(name: str, numbers: Sequence[float]) -> str:
    if not name.endswith("/sections"):
        return f'"{_row(numbers)}"'
    rows = [numbers[start : start + ROW] for start in range(0, len(numbers), ROW)]
    return '"\n' + "\n".join(f"      {_row(row)}" for row in rows) + '"'


def _row(numbers: Sequence[float] | FloatArray) -> str:
    return " ".join(map(_number, numbers))


def _number(value: float) -> str:
    """Return the shortest text that reads back as the same number."""
    return repr(float(value) + 0.0).removesuffix(".0")  # -0.0 + 0.0 is 0.0


def _comment(lines: Sequence[str], indent: str = "") -> str:
    """Return an XML comment, which must hold no control characters and no two hyphens."""
    plain = [
        "".join(c if c.isprintable() else " " for c in line).rstrip() for text in lines for line in text.splitlines()
    ]
    inside = re.sub("-(?=-)", "- ", f"\n{indent}     ".join(plain))
    return f"<!-- {inside} -->"
