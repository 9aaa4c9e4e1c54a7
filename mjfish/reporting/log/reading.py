"""Opening a log: in the rerun viewer, or read back to be drawn once more as a picture."""

from __future__ import annotations

import subprocess
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any, cast

import numpy as np
from rerun.chunk import RrdReader

from mjfish.errors import InputError, MjfishError
from mjfish.mujoco.offscreen import Mesh
from mjfish.numerics.arrays import FloatArray
from mjfish.reporting.log.drawing import COLOURS, FORCES, Drawing, Figure
from mjfish.reporting.log.recording import TIMELINE
from mjfish.reporting.log.scene import Swimmer


class ViewerError(MjfishError, RuntimeError):
    """The viewer could not be run."""


#: First bytes of every .rrd file.
_MAGIC = b"RRF2"


def view(path: Path) -> None:
    """Open `path` in the rerun viewer; return when it is closed.

    Raises:
        InputError: the file is absent or no rerun log.
        ViewerError: the viewer could not be run.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file; write a log with --rrd FILE.rrd, or by mjfish simulate --out DIR")
    with path.open("rb") as stream:
        if stream.read(len(_MAGIC)) != _MAGIC:
            raise InputError(f"{path}: not a rerun log (.rrd); give the file that --rrd wrote")
    done = subprocess.run([sys.executable, "-m", "rerun", str(path.resolve())], check=False)  # noqa: S603
    if done.returncode != 0:
        raise ViewerError(
            f"{path}: the rerun viewer ended with code {done.returncode}, expected 0; it needs a display: "
            "copy the file to a machine that has one and run 'rerun FILE.rrd' there"
        )


#: Pieces of one component of one entity: times [s], none of what stays, and values.
_Pieces = list[tuple[FloatArray | None, Any]]


def read_log(path: Path) -> list[Drawing]:
    """Return the runs of a log of `mjfish`, in the order of their names.

    Raises:
        InputError: it is no log, or one in which no fish swims.
    """
    found: dict[str, dict[str, _Pieces]] = defaultdict(lambda: defaultdict(list))
    try:
        for chunk in RrdReader(path).stream().to_chunks():
            batch = chunk.to_record_batch()
            names = batch.schema.names
            time = np.asarray(batch.column(TIMELINE).cast("int64")) * 1e-9 if TIMELINE in names else None
            for name in names:
                if name not in (TIMELINE, "rerun.controls.RowId"):
                    found[str(chunk.entity_path)][name].append((time, batch.column(name).to_pylist()))
    except (OSError, ValueError, RuntimeError) as error:
        raise InputError(f"{path}: cannot be read as a log: {error}; give one that mjfish wrote") from None
    drawings = [_drawing(found, root) for root, values in sorted(found.items()) if "arrow_scale" in values]
    if not drawings:
        raise InputError(f"{path}: no fish swims in it, expected a log of this version of mjfish; write it anew")
    return drawings


def _drawing(found: dict[str, dict[str, _Pieces]], root: str) -> Drawing:
    about = found[root]
    part = {"held_out": True, "fitted": False}.get(_static(about, "part"))
    worlds = {swimmer: f"{root}/world/{swimmer}" for swimmer in COLOURS}
    figures = tuple(
        _figure(found, cast(Swimmer, swimmer), world) for swimmer, world in worlds.items() if world in found
    )
    name, source, length, scale = (_static(about, key) for key in ("run", "source", "length", "arrow_scale"))
    return Drawing(name, source, part, length, figures, scale)


def _figure(found: dict[str, dict[str, _Pieces]], swimmer: Swimmer, world: str) -> Figure:
    about = found[world]
    links = sum(entity.startswith(f"{world}/link_") for entity in found)
    bodies = [found[f"{world}/link_{k}"] for k in range(links)]
    meshes = tuple(
        Mesh(
            np.array(_all(body, "Mesh3D:vertex_positions"), dtype=np.float64),
            np.array(_all(body, "Mesh3D:triangle_indices"), dtype=np.uint32),
        )
        for body in bodies
    )
    path = np.array(_all(found[f"{world}/path"], "LineStrips3D:strips")[0], dtype=np.float64)
    moves = [_over_time(body, "Transform3D:translation") for body in bodies]
    time, place = moves[0][0], np.stack([values[:, 0] for _, values in moves], axis=1)
    turn = np.stack([_over_time(body, "Transform3D:quaternion")[1][:, 0] for body in bodies], axis=1)
    forces = {kind: found[entity] for kind in FORCES if (entity := f"{world}/force/{kind}") in found}
    arrows = {
        kind: (_over_time(own, "Arrows3D:origins")[1], _over_time(own, "Arrows3D:vectors")[1])
        for kind, own in forces.items()
    }
    error = _static(about, "error")
    return Figure(
        swimmer, _static(about, "words"), _static(about, "ghost"), time, path, meshes, place, turn, arrows,
        None if np.isnan(error) else error,
    )  # fmt: skip


def _all(components: dict[str, _Pieces], name: str) -> Any:
    """Return every instance of a component that does not change."""
    return next(values[0] for time, values in components[name] if time is None)


def _static(components: dict[str, _Pieces], name: str) -> Any:
    return _all(components, name)[0]


def _over_time(components: dict[str, _Pieces], name: str) -> tuple[FloatArray, FloatArray]:
    """Return times (n,) [s] and values of a component."""
    pieces = [(time, values) for time, values in components[name] if time is not None]
    time, values = (
        np.concatenate([np.array(piece, dtype=np.float64) for piece in part]) for part in zip(*pieces, strict=True)
    )
    order = np.argsort(time, kind="stable")
    return time[order], values[order]
