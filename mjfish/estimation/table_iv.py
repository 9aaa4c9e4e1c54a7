"""The layout of [Yu2016], Table IV, for any dataset: RMSE and nRMSE of every trial, the paper's beside them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from mjfish.data import Trial
from mjfish.drive import modes
from mjfish.estimation.agreement import Agreement, agreement
from mjfish.estimation.residual import Residual
from mjfish.frames import CHANNELS, UNITS

Group = Literal["forward", "turning", ""]
Triple = tuple[float, float, float]

#: [Yu2016], Table IV: RMSE [m/s, m/s, rad/s] and normalised RMSE [-] of V_x, V_y, V_w; its signs of the axes do not
#: matter here (mjfish.frames).
PAPER: dict[str, tuple[Triple, Triple]] = {
    "v1": ((0.040, 0.042, 0.253), (0.097, 0.047, 0.051)),
    "v3": ((0.051, 0.044, 0.349), (0.105, 0.043, 0.056)),
    "v5": ((0.073, 0.058, 0.508), (0.123, 0.058, 0.079)),
    "v7": ((0.095, 0.073, 0.619), (0.142, 0.068, 0.084)),
    "v1-v5": ((0.053, 0.035, 0.298), (0.117, 0.045, 0.059)),
    "v5-v1": ((0.062, 0.038, 0.276), (0.111, 0.034, 0.039)),
    "v1-t1": ((0.041, 0.036, 0.245), (0.109, 0.045, 0.048)),
    "v1-t2": ((0.041, 0.046, 0.304), (0.115, 0.059, 0.061)),
    "v3-t1": ((0.047, 0.041, 0.198), (0.100, 0.046, 0.034)),
    "v3-t2": ((0.057, 0.054, 0.335), (0.119, 0.053, 0.051)),
}


@dataclass(frozen=True)
class Row:
    """One line: a trial, or the mean of a group of trials.

    Attributes:
        name: of the trial, or ``mean of forward`` and the like.
        mode: of Table IV, empty where the drive is none of them.
        group: ``forward`` (no bias at any time), ``turning``; empty where joints were measured.
        role: ``fit``, ``held_out``; empty for means of both.
        trials: how many.
        rmse: [m/s, m/s, rad/s].
        nrmse: [-].
        paper_rmse, paper_nrmse: the paper's of the same mode, or their mean over the same trials; None where any of
            them is no mode of the paper.
    """

    name: str
    mode: str
    group: Group
    role: str
    trials: int
    rmse: Triple
    nrmse: Triple
    paper_rmse: Triple | None
    paper_nrmse: Triple | None

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data, flat, the unit part of the name."""
        flat: dict[str, Any] = {key: getattr(self, key) for key in ("name", "mode", "group", "role", "trials")}
        for kind in ("rmse", "nrmse", "paper_rmse", "paper_nrmse"):
            for channel, value in zip(CHANNELS, getattr(self, kind) or (None, None, None), strict=True):
                flat[f"{kind}_{channel} [{'-' if 'nrmse' in kind else UNITS[channel]}]"] = value
        return flat


def table_iv(residuals: Sequence[Residual]) -> tuple[Row, ...]:
    """Return a row for every trial, then the means of forward and turning trials, then of all.

    Args:
        residuals: of simulations, of fitted and held-out trials in the order of the rows.
    """
    found = agreement(residuals, horizons=())
    rows = [
        _of(residual.trial, residual.role, [a for a in found if a.trial == residual.trial.name])
        for residual in residuals
    ]
    means = [_mean(f"mean of {group}", [row for row in rows if row.group == group]) for group in ("forward", "turning")]
    return (*rows, *(row for row in (*means, _mean("mean of all", rows)) if row is not None and row.trials > 1))


def text(value: float, normalised: float) -> str:
    """Return a cell as RMSE / nRMSE, three places as the paper prints them."""
    return f"{value:.3f} / {normalised:.3f}" if np.isfinite(value) else "–"


def mode_of(trial: Trial) -> str:
    """Return the mode of Table IV that a trial was driven by; empty if by none."""
    if not trial.drive:
        return ""
    joints = len(trial.drive[0].bias)
    return next((mode for mode in modes.MODES if modes.drive(mode, joints) == trial.drive), "")


def group_of(trial: Trial) -> Group:
    """Return whether the drive ever turns the fish; empty where the drive is not known."""
    if not trial.drive:
        return ""
    return "turning" if any(any(segment.bias) for segment in trial.drive) else "forward"


def _of(trial: Trial, role: str, found: Iterable[Agreement]) -> Row:
    by_channel = {a.channel: a for a in found if a.part == "whole"}
    mode = mode_of(trial)
    paper = PAPER.get(mode, (None, None))
    return Row(
        name=trial.name,
        mode=mode,
        group=group_of(trial),
        role=role,
        trials=1,
        rmse=_triple([by_channel[c].rmse if c in by_channel else np.nan for c in CHANNELS]),
        nrmse=_triple([by_channel[c].nrmse if c in by_channel else np.nan for c in CHANNELS]),
        paper_rmse=paper[0],
        paper_nrmse=paper[1],
    )


def _mean(name: str, rows: Sequence[Row]) -> Row | None:
    """Return the mean of rows, None of none."""
    if not rows:
        return None
    roles, groups = {row.role for row in rows}, {row.group for row in rows}
    return Row(
        name=name,
        mode="",
        group=groups.pop() if len(groups) == 1 else "",
        role=roles.pop() if len(roles) == 1 else "",
        trials=len(rows),
        rmse=_triple(np.mean([row.rmse for row in rows], axis=0)),
        nrmse=_triple(np.mean([row.nrmse for row in rows], axis=0)),
        paper_rmse=_paper_mean([row.paper_rmse for row in rows]),
        paper_nrmse=_paper_mean([row.paper_nrmse for row in rows]),
    )


def _paper_mean(values: Sequence[Triple | None]) -> Triple | None:
    """Return the mean of the paper's numbers; None where one of the trials has none."""
    known = [value for value in values if value is not None]
    return _triple(np.mean(known, axis=0)) if len(known) == len(values) else None


def _triple(values: Iterable[float]) -> Triple:
    surge, sway, yaw_rate = (float(v) for v in values)
    return surge, sway, yaw_rate
