"""How a log opens: the fish on the left, velocities and residuals over time on the right, one tab a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import rerun as rr
import rerun.blueprint as rrb

from mjfish.frames import CHANNELS, UNITS
from mjfish.reporting.log.scene import Run

#: Of a fish that is free in space, and their units.
ATTITUDE = {"roll": "rad", "pitch": "rad", "heave": "m"}


def blueprint(runs: Sequence[Run]) -> rrb.Blueprint:
    """Return the layout of a log of `runs`."""
    tabs = [_tab(run) for run in runs]
    return rrb.Blueprint(
        tabs[0] if len(tabs) == 1 else rrb.Tabs(*tabs, active_tab=0),
        rrb.TimePanel(state="collapsed", timeline="sim_time", play_state="playing", loop_mode="all"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        auto_views=False,
    )


def _tab(run: Run) -> rrb.Horizontal:
    root = "/" + rr.escape_entity_path_part(run.name)
    curves = [_curves(f"{root}/velocity", "")]
    if run.residuals():
        curves.append(_curves(f"{root}/residual", " residual"))
    if any(swim.attitude is not None for swim in run.swims):
        curves.append(_curves(f"{root}/attitude", "", ATTITUDE))
    left = rrb.Vertical(_swimming(root, run), rrb.TextDocumentView(origin="/about", name="About"), row_shares=[4, 1])
    return rrb.Horizontal(
        left,
        *curves,
        column_shares=[5, *([4] * len(curves))],
        name=f"{run.name}{' (held out)' if run.held_out else ''}",
    )


def _swimming(root: str, run: Run) -> rrb.Spatial3DView:
    """Look from aside and above at the camera's point, which swims along."""
    length = run.fish.length
    return rrb.Spatial3DView(
        origin=f"{root}/world/camera",
        contents=f"{root}/world/**",
        name="Swimming",
        background=rrb.Background(color=[22, 25, 30]),
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=(-0.35 * length, -1.15 * length, 1.15 * length),
            look_target=(0.0, 0.05 * length, 0.0),
            eye_up=(0.0, 0.0, 1.0),
        ),
    )


def _curves(root: str, kind: str, units: Mapping[str, str] = UNITS) -> rrb.Vertical:
    """Return one plot a channel; the first has the legend."""
    return rrb.Vertical(
        *(
            rrb.TimeSeriesView(
                origin=f"{root}/{channel}",
                name=f"{channel.replace('_', ' ')}{kind} [{unit}]",
                plot_legend=rrb.PlotLegend(rrb.Corner2D.RightBottom, visible=channel == CHANNELS[0]),
            )
            for channel, unit in units.items()
        )
    )
