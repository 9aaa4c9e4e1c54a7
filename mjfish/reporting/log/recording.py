"""Writing a recording: how it opens, and its columns, to a file that is there whole or not at all.

Colours and the scale of arrows are the same in every view. The camera looks at a point that glides along with the
fish; a floor shows how far it swims.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from mjfish.diagnosis.forms import NamedMechanism
from mjfish.errors import InputError
from mjfish.files.writing import whole
from mjfish.fish.frames import CHANNELS, UNITS
from mjfish.numerics.arrays import FloatArray
from mjfish.reporting.log.curves import form_tab, log_curves
from mjfish.reporting.log.drawing import (
    COLOURS,
    FORCES,
    Drawing,
    Figure,
    arrow_scale,
    beat_paths,
    camera_path,
    drawn,
    floor_height,
    normals,
    reach,
)
from mjfish.reporting.log.scene import Run

#: Of a fish that is free in space, and their units.
ATTITUDE = {"roll": "rad", "pitch": "rad", "heave": "m"}
_CHANNELS = {channel: channel.replace("_", " ") for channel in CHANNELS}


def blueprint(
    runs: Sequence[Run], drawings: Sequence[Drawing], mechanisms: Sequence[NamedMechanism] = ()
) -> rrb.Blueprint:
    """Return the layout of a log of `runs` and how they are drawn; curves of mechanisms have a tab behind them."""
    forms = form_tab(mechanisms)
    tabs = [_tab(run, drawing) for run, drawing in zip(runs, drawings, strict=True)]
    tabs += [] if forms is None else [forms]
    return rrb.Blueprint(
        tabs[0] if len(tabs) == 1 else rrb.Tabs(*tabs, active_tab=0),
        rrb.TimePanel(state="collapsed", timeline="sim_time", play_state="playing", loop_mode="all"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        auto_views=False,
    )


def _tab(run: Run, drawing: Drawing) -> rrb.Horizontal:
    root, far = "/" + rr.escape_entity_path_part(run.name), _far(run, drawing)
    joints = {f"joint_{k + 1}": f"joint {k + 1} [rad]" for k in range(run.fish.joints)}
    joints |= {} if run.phase is None else {"phase": "phase of the beat [-]"}
    others = [_plots(f"{root}/joints", joints, "Joints")]
    if run.residuals():
        titles = {channel: f"{title} residual [{UNITS[channel]}]" for channel, title in _CHANNELS.items()}
        others.insert(0, _plots(f"{root}/residual", titles, "Residuals"))
    if any(swim.attitude is not None for swim in run.swims):
        titles = {channel: f"{channel} [{unit}]" for channel, unit in ATTITUDE.items()}
        others.insert(0, _plots(f"{root}/attitude", titles, "Attitude"))
    said = [rrb.TextDocumentView(origin="/about", name="About")]
    if run.events:
        said.append(rrb.TextLogView(origin=f"{root}/events", name="Events"))
    # From aside and above at the camera's point, so far off that every fish is in view at all times; x to the right.
    aside = _view(root, "Swimming", (-0.35 * far, -1.15 * far, 1.15 * far), (0.0, 0.0, 1.0))
    above = _view(root, "From above", (0.0, 0.0, 1.9 * far), (0.0, 1.0, 0.0))
    return rrb.Horizontal(
        rrb.Vertical(rrb.Tabs(aside, above, active_tab=0), rrb.Tabs(*said, active_tab=0), row_shares=[4, 1]),
        _plots(f"{root}/velocity", {channel: f"{title} [{UNITS[channel]}]" for channel, title in _CHANNELS.items()}),
        rrb.Tabs(*others, active_tab=0),
        column_shares=[5, 4, 4],
        name=f"{run.name}{' (held out)' if run.held_out else ''}",
    )


def _far(run: Run, drawing: Drawing) -> float:
    """Return a length of the fish, or more where the fish of a run part from each other [m]."""
    time = run.swims[-1].time
    return max(drawing.length, _IN_VIEW * reach(drawing.figures, camera_path(drawing.figures, time), time))


def _view(
    root: str, name: str, position: tuple[float, float, float], up: tuple[float, float, float]
) -> rrb.Spatial3DView:
    return rrb.Spatial3DView(
        origin=f"{root}/world/camera",
        contents=f"{root}/world/**",
        name=name,
        background=rrb.Background(color=[22, 25, 30]),
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital, position=position, look_target=(0.0, 0.0, 0.0), eye_up=up
        ),
    )


def _plots(root: str, titles: Mapping[str, str], name: str | None = None) -> rrb.Vertical:
    """Return one plot an entity below `root`; that of the first channel or joint has the legend."""
    views = (
        rrb.TimeSeriesView(
            origin=f"{root}/{entity}",
            name=title,
            plot_legend=rrb.PlotLegend(rrb.Corner2D.RightBottom, visible=entity in (CHANNELS[0], "joint_1")),
        )
        for entity, title in titles.items()
    )
    return rrb.Vertical(*views, name=name)


APPLICATION = "mjfish"
#: Every run has its own time, from its own start, on this line.
TIMELINE = "sim_time"
#: Of the band of other fish in the same run.
BAND = (130, 136, 145, 255)
FLOOR = (70, 78, 90, 255)
#: The camera is farther away than a length of the fish where the fish part: this share of how far.
_IN_VIEW = 1.1
#: The viewer draws the curves of a plot in the order of their entities: this one is the last, above the others.
_CURVES = {"extended": "with_cause"}
#: Spacing of the floor's lines and its margin, in lengths of the fish.
_SPACING, _MARGIN = 0.5, 3.0


def write_runs(
    path: Path, runs: Sequence[Run], *, name: str, about: str, mechanisms: Sequence[NamedMechanism] = ()
) -> None:
    """Write runs to an .rrd file, with a blueprint that shows them one a tab, the first in front.

    Per run: ``/RUN/world/SWIMMER/link_K`` the body with a transform over time, ``/RUN/world/SWIMMER/path``,
    ``.../beats`` the path begun anew on the measured one at every beat, ``/RUN/world/SWIMMER/force/drag`` and
    ``.../added_mass``, ``/RUN/velocity/CHANNEL/SWIMMER`` and ``/RUN/residual/CHANNEL/SWIMMER``, where ``with_cause``
    stands for the extended fish, ``/RUN/joints/joint_K/command`` and ``.../SWIMMER``, ``/RUN/joints/phase/beat`` from 0
    to 1, ``/RUN/events``, of a band of other fish ``/RUN/velocity/CHANNEL/draws_5`` and so on, of a fish in space
    ``/RUN/attitude/roll/SWIMMER`` and so on, all on the duration timeline ``sim_time``. Curves are
    ``/curves/MECHANISM/QUANTITY-GROUP``, see `mjfish.reporting.log.curves`.

    Args:
        path: of the file; one that is there is replaced.
        runs: at least one.
        name: of the recording.
        about: Markdown shown beside the swimming.
        mechanisms: whose curves are shown in a tab of their own.

    Raises:
        InputError: no runs, two of one name, or the file cannot be written.
    """
    names = [run.name for run in runs]
    if not names or len(set(names)) < len(names):
        raise InputError(f"{path}: a log needs runs with names of their own, found {names}")
    with whole(path) as partial:
        _record(partial, runs, name, about, mechanisms)


def _record(path: Path, runs: Sequence[Run], name: str, about: str, mechanisms: Sequence[NamedMechanism]) -> None:
    scale = arrow_scale(runs)
    recording = rr.RecordingStream(APPLICATION)
    drawings = [drawn(run, scale, name) for run in runs]
    recording.save(path, default_blueprint=blueprint(runs, drawings, mechanisms))
    recording.send_recording_name(name)
    if any(swim.forces is not None for run in runs for swim in run.swims):
        about += f"\n\nArrows: 1 N is {scale:g} m."
    recording.log("about", rr.TextDocument(about, media_type=rr.MediaType.MARKDOWN), static=True)
    for run, drawing in zip(runs, drawings, strict=True):
        root = "/" + rr.escape_entity_path_part(run.name)
        _about(recording, root, drawing)
        _water(recording, f"{root}/world", run, drawing)
        for figure in drawing.figures:
            _figure(recording, f"{root}/world/{figure.swimmer}", figure)
        for swim in run.swims:
            _series(recording, f"{root}/velocity", swim.swimmer, swim.time, swim.velocity)
            if swim.attitude is not None:
                _series(recording, f"{root}/attitude", swim.swimmer, swim.time, swim.attitude, tuple(ATTITUDE))
        _drive(recording, root, run)
        _beats(recording, f"{root}/world", run, drawing)
        if run.band is not None:
            for level, velocity in zip(run.band.levels, run.band.velocity, strict=True):
                _series(recording, f"{root}/velocity", f"draws_{level:g}", run.band.time, velocity)
        for swimmer, (time, residual) in run.residuals().items():
            _series(recording, f"{root}/residual", swimmer, time, residual)
    log_curves(recording, mechanisms)
    recording.flush()
    recording.disconnect()


def _drive(recording: rr.RecordingStream, root: str, run: Run) -> None:
    """Log angles of the joints, what they were told, the phase of the beat and the events."""
    names = [f"joint_{k + 1}" for k in range(run.fish.joints)]
    time = run.swims[0].time
    if run.command is not None:
        _series(recording, f"{root}/joints", "command", time, run.command, names)
    for swim in run.swims:
        if not swim.ghost:
            _series(recording, f"{root}/joints", swim.swimmer, swim.time, swim.joint_angle, names)
    if run.phase is not None:
        _series(recording, f"{root}/joints", "beat", time, np.mod(run.phase / (2.0 * np.pi), 1.0)[:, None], ["phase"])
    if run.events:
        times, words = zip(*run.events, strict=True)
        said = rr.TextLog.columns(text=words, level=["INFO"] * len(words))
        recording.send_columns(f"{root}/events", [rr.TimeColumn(TIMELINE, duration=np.array(times))], said)


def _beats(recording: rr.RecordingStream, root: str, run: Run, drawing: Drawing) -> None:
    """Log the paths of the simulated noses, begun anew on the measured one at every beat."""
    if run.phase is None:
        return
    turns = np.maximum.accumulate(np.floor(np.abs(run.phase - run.phase[0]) / (2.0 * np.pi)))
    starts = run.swims[0].time[np.flatnonzero(np.diff(turns, prepend=-1.0) > 0.0)]
    measured, *others = drawing.figures
    for figure in others:
        pieces = rr.LineStrips3D(
            beat_paths(figure, measured, starts), colors=[COLOURS[figure.swimmer]], radii=rr.Radius.ui_points(0.6)
        )
        recording.log(f"{root}/{figure.swimmer}/beats", pieces, static=True)


def _about(recording: rr.RecordingStream, root: str, drawing: Drawing) -> None:
    """Log what `mjfish.reporting.log.reading` needs beside what is seen: names, the part of the run, errors."""
    of_run = rr.AnyValues(
        run=drawing.name,
        source=drawing.source,
        part={None: "simulated", True: "held_out", False: "fitted"}[drawing.held_out],
        length=drawing.length,
        arrow_scale=drawing.scale,
    )
    recording.log(root, of_run, static=True)
    for figure in drawing.figures:
        error = math.nan if figure.error is None else figure.error
        of_figure = rr.AnyValues(words=figure.words, ghost=figure.ghost, error=error)
        recording.log(f"{root}/world/{figure.swimmer}", of_figure, static=True)


def _water(recording: rr.RecordingStream, root: str, run: Run, drawing: Drawing) -> None:
    """Log the floor of the tank and the point that the camera looks at."""
    recording.log(root, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    floor = rr.LineStrips3D(floor_lines(drawing), colors=[FLOOR], radii=rr.Radius.ui_points(0.6))
    recording.log(f"{root}/floor", floor, static=True)
    time = run.swims[-1].time
    seen = rr.Transform3D.columns(translation=camera_path(drawing.figures, time))
    recording.send_columns(f"{root}/camera", [rr.TimeColumn(TIMELINE, duration=time)], seen)


def _figure(recording: rr.RecordingStream, root: str, figure: Figure) -> None:
    """Log the body, the path of the nose and the arrows of the forces."""
    path = rr.LineStrips3D([figure.path], colors=[COLOURS[figure.swimmer]], radii=rr.Radius.ui_points(1.2))
    recording.log(f"{root}/path", path, static=True)
    for k, mesh in enumerate(figure.meshes):
        body = rr.Mesh3D(
            vertex_positions=mesh.vertices,
            triangle_indices=mesh.triangles,
            vertex_normals=normals(mesh),
            albedo_factor=figure.colour,
        )
        moves = rr.Transform3D.columns(translation=figure.place[:, k], quaternion=figure.turn[:, k])
        _columns(recording, f"{root}/link_{k}", body, figure.time, moves)
    for kind, (origins, vectors) in figure.arrows.items():
        style = rr.Arrows3D.from_fields(colors=[FORCES[kind]], radii=rr.Radius.ui_points(2.5))
        arrows = rr.Arrows3D.columns(origins=origins.reshape(-1, 3), vectors=vectors.reshape(-1, 3))
        at_times = arrows.partition([origins.shape[1]] * len(origins))
        _columns(recording, f"{root}/force/{kind}", style, figure.time, at_times)


def _series(
    recording: rr.RecordingStream,
    root: str,
    name: str,
    time: FloatArray,
    values: FloatArray,
    channels: Sequence[str] = CHANNELS,
) -> None:
    """Log one curve a channel, of a swimmer or of another name."""
    style = rr.SeriesLines(names=name, colors=COLOURS.get(name, BAND), widths=1.6 if name in COLOURS else 0.8)
    for k, channel in enumerate(channels):
        entity = f"{root}/{channel}/{_CURVES.get(name, name)}"
        _columns(recording, entity, style, time, rr.Scalars.columns(scalars=values[:, k]))


def _columns(recording: rr.RecordingStream, entity: str, style: Any, time: FloatArray, columns: Any) -> None:
    """Log what of an entity stays, and what changes over time (n,) [s]."""
    recording.log(entity, style, static=True)
    recording.send_columns(entity, [rr.TimeColumn(TIMELINE, duration=time)], columns)


def floor_lines(drawing: Drawing) -> list[FloatArray]:
    """Return the lines of a square grid below everything that swims in the run, each (2, 3) [m]."""
    length = drawing.length
    spacing = _SPACING * length
    places = np.concatenate([figure.path[:, :2] for figure in drawing.figures])
    low = np.floor((places.min(axis=0) - _MARGIN * length) / spacing)
    high = np.ceil((places.max(axis=0) + _MARGIN * length) / spacing)
    z = floor_height(drawing.figures, length)
    (x0, y0), (x1, y1) = spacing * low, spacing * high
    rows = [np.array([[x0, y, z], [x1, y, z]]) for y in spacing * np.arange(low[1], high[1] + 1)]
    columns = [np.array([[x, y0, z], [x, y1, z]]) for x in spacing * np.arange(low[0], high[0] + 1)]
    return rows + columns
