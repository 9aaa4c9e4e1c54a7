"""Whether what was taken for noise is too large to be one: a misfit that is slow enough looks like coloured noise."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from mjfish.estimation import Fit, Noise, Problem
from mjfish.frames import CHANNELS, UNITS
from mjfish.inspection import Finding, Repeats
from mjfish.noise import Autoregressive, GaussMarkov, ProcessNoise

#: Share of a channel, both rms, up to which slow noise is believed; of cameras over a tank it is a few hundredths.
_LARGEST = 0.06
#: Slow is what a mean over this time leaves [s].
_SLOW = 0.2
#: Share of it that repeated runs must show, for it to be noise all the same.
_REPEATED = 0.7


def too_large(problem: Problem, fit: Fit, repeats: Repeats | None) -> Finding | None:
    """Return the finding that noise which has a colour is as large as a part of the motion; None where it is not.

    Its estimate takes for noise whatever the candidates do not explain: nothing may seem wrong with a simulation that
    is far off. Repeated runs tell them apart, for noise differs between them and a misfit does not.

    Args:
        problem: of the nominal model, with the noise that was found.
        fit: its result.
        repeats: the noise that repeated runs show, if any were.
    """
    if not _slow(problem.noise):
        return None
    moves = np.concatenate([trial.velocity[problem.mask(i)] for i, trial in enumerate(problem.trials)])
    width = max(round(_SLOW / problem.trials[0].step), 1)
    slow = np.concatenate([ndimage.uniform_filter1d(one, width, axis=0) for one in problem.raw(fit.x)])
    error, size = (np.sqrt(np.mean(one**2, axis=0)) for one in (slow, moves))
    large = error > _LARGEST * size
    if repeats is not None:
        large &= repeats.sigma < _REPEATED * error
    if not large.any():
        return None
    worst = int(np.argmax(np.where(large, error / np.maximum(size, 1e-12), 0.0)))
    channel, share = CHANNELS[worst], error[worst] / size[worst]
    off = f"{error[worst]:.2g} {UNITS[channel]} rms over {_SLOW} s and more"
    return Finding(
        code="noise-slow",
        severity="blocks",
        place=channel,
        found=f"the simulation is off by {off}, {share:.0%} of all of it; that may be noise, or something that no "
        "known cause explains",
        expected=f"slow noise of at most {_LARGEST:.0%}",
        remedy="swim one drive twice or more: noise differs between repeats, an effect does not",
        channels=tuple(name for name, one in zip(CHANNELS, large, strict=True) if one),
    )


def _slow(noise: Noise) -> bool:
    """Return whether a noise is slow enough that a misfit could pass for it: not white, nor that of differentiation."""
    return isinstance(noise, GaussMarkov | ProcessNoise) or (isinstance(noise, Autoregressive) and noise.order > 0)
