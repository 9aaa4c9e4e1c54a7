"""Sparse regression on differentiated velocities, as one would do it without a simulator's sensitivities in time.

Measured less simulated velocities are differentiated by a cubic over nine samples, and so is what each coefficient and
each cause would do to them, less what the coefficients do; thresholded least squares ([Brunton2016]) then drops, one by
one, the cause that moves the fish least. Nothing is whitened.

[Brunton2016] S. Brunton, J. Proctor, J. Kutz, PNAS 113.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy import signal

from mjfish.data import Dataset
from mjfish.design import FittedModels
from mjfish.effects import Effect, catalogue, of_fish
from mjfish.estimation import Problem, fit
from mjfish.numerics.arrays import FloatArray

_WINDOW, _DEGREE = 9, 3


def sparsest(dataset: Dataset) -> str:
    """Return the cause that sequential thresholding leaves last."""
    effects = of_fish(catalogue(), dataset.fish).values()
    candidates = [effect for effect in effects if not effect.not_applicable(dataset)]
    problem = FittedModels.undiagnosed(dataset, {}).problem
    nominal = fit(problem, tolerance=1e-6)
    wrong = _differentiated([residual[:, :, None] for residual in problem.raw(nominal.x)])[:, 0]
    known = _differentiated(_whole(problem, nominal.x))
    span = np.linalg.qr(known)[0]
    library = _differentiated(_signatures(problem, nominal.values, candidates))
    library, wrong = library - span @ (span.T @ library), wrong - span @ (span.T @ wrong)
    widths = [sum(not p.shape for p in effect.parameters) for effect in candidates]
    ends = np.cumsum(widths)
    blocks = {e.name: np.arange(end - width, end) for e, end, width in zip(candidates, ends, widths, strict=True)}
    while len(blocks) > 1:
        columns = np.concatenate(list(blocks.values()))
        moved = dict(zip(columns, np.linalg.lstsq(library[:, columns], wrong, rcond=1e-6)[0], strict=True))
        worth = {name: np.linalg.norm(library[:, own] @ [moved[k] for k in own]) for name, own in blocks.items()}
        del blocks[min(worth, key=worth.__getitem__)]
    return next(iter(blocks))


def _whole(problem: Problem, x: FloatArray) -> list[FloatArray]:
    """Return, per trial, the derivative (n_r, 3, k) by every parameter, zero by those of other trials."""
    slopes, blocks = problem.slopes(x), []
    for block, own in zip(slopes.velocity, slopes.per_trial, strict=True):
        blocks.append(np.zeros((*block.shape[:2], slopes.count)))
        blocks[-1][:, :, [*slopes.shared, *own]] = block
    return blocks


def _signatures(problem: Problem, values: Mapping[str, float], candidates: Sequence[Effect]) -> list[FloatArray]:
    """Return, per trial, the derivative (n_r, 3, k) of the prediction by every candidate's amplitudes, times scale."""
    every = [p for effect in candidates for p in effect.parameters]
    amplitudes = [p for p in every if not p.shape]
    wide = replace(problem, model=replace(problem.model, effects=(*problem.model.effects, *candidates)))
    x = wide.start({p.name: p.default for p in every} | dict(values))
    blocks = wide.slopes(x, only=[p.name for p in amplitudes]).velocity
    return [block * np.array([p.scale for p in amplitudes]) for block in blocks]


def _differentiated(rows: list[FloatArray]) -> FloatArray:
    """Differentiate blocks (n_r, 3, k) over samples and stack them to (n, k)."""
    slopes = [signal.savgol_filter(block, _WINDOW, _DEGREE, deriv=1, axis=0) for block in rows]
    return np.concatenate([slope.reshape(-1, slope.shape[2]) for slope in slopes])
