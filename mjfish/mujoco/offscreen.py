"""Pictures of solid bodies, lines and arrows above the floor of a pool, drawn by MuJoCo without a window."""

from __future__ import annotations

import ctypes.util
import importlib
import os
import sys
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjfish.errors import InputError
from mjfish.numerics.arrays import FloatArray

#: Red, green, blue and opacity, 0 to 255.
Colour = tuple[int, int, int, int]
#: Geoms that one picture may have.
_ROOM = 20000
#: Field of view, upright [deg].
FIELD = 40.0
#: Of the floor, of its lines, and of what is far.
_FLOOR, _LINE, _FAR = (0.13, 0.24, 0.31), (0.24, 0.38, 0.46), (0.09, 0.17, 0.23)
#: Pixels of a tile of the floor, and of its line.
_TILE, _EDGE = 512, 6


@dataclass(frozen=True, eq=False)
class Mesh:
    """A closed surface: vertices (m, 3) [m] and triangles (t, 3) that face outwards."""

    vertices: FloatArray
    triangles: NDArray[np.uint32]


@dataclass(frozen=True, eq=False)
class Strokes:
    """Arrows, or pieces of a line, of one colour.

    Attributes:
        start, end: (k, 3) [m].
        width: [m].
        colour: of all.
        arrows: whether they have heads.
    """

    start: FloatArray
    end: FloatArray
    width: float
    colour: Colour
    arrows: bool = False


class Stage(AbstractContextManager["Stage"]):
    """Bodies in a pool, and the window-less renderer that draws them; a context that ends with the renderer.

    Args:
        bodies: mesh and colour of each; the same `Mesh` may occur many times.
        width, height: of the pictures [pixels].
        floor: height of the floor [m].
        spacing: of its lines [m].
        extent: of everything that will be seen, about [m]; it scales shadows and the depth of the view.

    Raises:
        InputError: this machine has no OpenGL that draws without a window.
    """

    def __init__(
        self,
        bodies: Sequence[tuple[Mesh, Colour]],
        *,
        width: int,
        height: int,
        floor: float,
        spacing: float,
        extent: float,
    ) -> None:
        context = _offscreen()
        self._model = _pool(bodies, floor, spacing, extent).compile()
        self._data = mujoco.MjData(self._model)
        self._rectangle = mujoco.MjrRect(0, 0, width, height)
        self._model.vis.global_.offwidth, self._model.vis.global_.offheight = width, height
        self._gl = _created(context, width, height)
        self._drawer = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._drawer)
        self._scene = mujoco.MjvScene(self._model, maxgeom=_ROOM)

    def picture(
        self,
        place: FloatArray,
        turn: FloatArray,
        strokes: Sequence[Strokes],
        *,
        target: FloatArray,
        distance: float,
        azimuth: float,
        elevation: float,
    ) -> NDArray[np.uint8]:
        """Return a picture (height, width, 3).

        Args:
            place: (k, 3) of the bodies' frames [m].
            turn: (k, 4) quaternions x, y, z, w of them.
            strokes: arrows and lines.
            target: x, y, z (3,) of the point that the camera looks at [m].
            distance: of the camera from it [m].
            azimuth: direction in which the camera looks, from x to y [deg].
            elevation: of that direction, negative downwards [deg].
        """
        self._data.mocap_pos[:], self._data.mocap_quat[:] = place, turn[:, [3, 0, 1, 2]]
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        eye = mujoco.MjvCamera()
        eye.lookat[:] = target
        eye.distance, eye.azimuth, eye.elevation = distance, azimuth, elevation
        shown, every = mujoco.MjvOption(), mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(self._model, self._data, shown, None, eye, every, self._scene)
        for stroke in strokes:
            self._add(stroke)
        pixels = np.empty((self._rectangle.height, self._rectangle.width, 3), dtype=np.uint8)
        self._gl.make_current()
        mujoco.mjr_render(self._rectangle, self._scene, self._drawer)
        mujoco.mjr_readPixels(pixels, None, self._rectangle, self._drawer)
        return pixels[::-1]

    def _add(self, strokes: Strokes) -> None:
        kind = mujoco.mjtGeom.mjGEOM_ARROW if strokes.arrows else mujoco.mjtGeom.mjGEOM_CAPSULE
        colour = np.array(strokes.colour, dtype=np.float32) / 255.0
        reach = 2.0 if strokes.arrows else 1.0  # MuJoCo draws an arrow half as long as it is
        for start, end in zip(strokes.start, strokes.start + reach * (strokes.end - strokes.start), strict=True):
            if self._scene.ngeom >= self._scene.maxgeom:
                return
            geom = self._scene.geoms[self._scene.ngeom]
            mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.zeros(9), colour)
            mujoco.mjv_connector(geom, kind, strokes.width, start, end)
            geom.emission = 0.15
            self._scene.ngeom += 1

    def __exit__(self, *_: object) -> None:
        """Free the renderer."""
        self._gl.make_current()
        self._drawer.free()
        self._gl.free()


def _pool(bodies: Sequence[tuple[Mesh, Colour]], floor: float, spacing: float, extent: float) -> mujoco.MjSpec:
    """Return a model of the bodies, each moved freely, above a floor."""
    spec = mujoco.MjSpec()
    spec.stat.extent, spec.stat.center = extent, (0.0, 0.0, 0.0)
    visual = spec.visual
    visual.global_.fovy = FIELD
    visual.quality.offsamples = 4
    visual.headlight.ambient, visual.headlight.diffuse = (0.5, 0.5, 0.5), (0.25, 0.25, 0.25)
    visual.headlight.specular = (0.05, 0.05, 0.05)
    visual.map.znear, visual.map.zfar = 0.01, 60.0
    light = spec.worldbody.add_light(pos=(0.0, 0.0, 4.0 * extent), dir=(0.25, 0.3, -1.0))
    light.type, light.castshadow = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, False
    light.diffuse, light.specular = (0.35, 0.35, 0.35), (0.15, 0.15, 0.15)
    _add_floor(spec, floor, spacing)
    for mesh in {id(mesh): mesh for mesh, _ in bodies}.values():
        asset = spec.add_mesh(
            name=f"mesh_{id(mesh)}",
            uservert=mesh.vertices.ravel().tolist(),
            userface=mesh.triangles.ravel().tolist(),
        )
        asset.inertia, asset.smoothnormal = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL, True
    for mesh, colour in bodies:
        body = spec.worldbody.add_body(mocap=True)
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=f"mesh_{id(mesh)}",
            rgba=np.array(colour) / 255.0,
            contype=0,
            conaffinity=0,
        )
    return spec


def _add_floor(spec: mujoco.MjSpec, height: float, spacing: float) -> None:
    """Add a floor without end, ruled in squares, and what is behind it."""
    spec.add_texture(
        name="far",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        rgb1=_FAR,
        rgb2=_FAR,
        width=8,
        height=8,
    )
    tile = np.full((_TILE, _TILE, 3), np.array(_FLOOR) * 255.0)
    tile[:_EDGE] = tile[:, :_EDGE] = np.array(_LINE) * 255.0
    texture = spec.add_texture(name="floor", type=mujoco.mjtTexture.mjTEXTURE_2D, width=_TILE, height=_TILE, nchannel=3)
    texture.data = tile.astype(np.uint8).tobytes()
    material = spec.add_material(name="floor", texrepeat=(1.0 / spacing, 1.0 / spacing), texuniform=True)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "floor"
    material.specular, material.shininess = 0.0, 0.0
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=(0.0, 0.0, 0.1),
        pos=(0.0, 0.0, height),
        material="floor",
        contype=0,
        conaffinity=0,
    )


def _offscreen() -> str:
    """Return the module of MuJoCo that has an OpenGL without a window: the one that MUJOCO_GL names, else EGL, OSMesa.

    Raises:
        InputError: there is none.
    """
    asked = os.environ.get("MUJOCO_GL", "").lower().strip()
    if asked in ("egl", "osmesa", "glfw", "cgl"):
        return f"mujoco.{asked}"
    if sys.platform != "linux":
        return "mujoco.cgl" if sys.platform == "darwin" else "mujoco.glfw"
    for name, library in (("egl", "EGL"), ("osmesa", "OSMesa")):
        if ctypes.util.find_library(library) is not None:
            return f"mujoco.{name}"
    raise InputError(
        "render: this machine has no OpenGL that draws without a window, expected EGL or OSMesa; "
        "install one (Debian: libegl1 and libgl1-mesa-dri, or libosmesa6), or render elsewhere"
    )


def _created(module: str, width: int, height: int) -> Any:
    """Return an OpenGL context that is current.

    Raises:
        InputError: it cannot be made.
    """
    try:  # what goes wrong here has many types: of ctypes, of PyOpenGL, of MuJoCo
        context = importlib.import_module(module).GLContext(width, height)
        context.make_current()
    except Exception as error:
        raise InputError(
            f"render: OpenGL does not start by {module}: {error}; name another one by the environment variable "
            "MUJOCO_GL (egl or osmesa), or install its drivers (Debian: libgl1-mesa-dri)"
        ) from None
    return context
