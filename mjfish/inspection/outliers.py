"""Single samples that no noise explains, and noise with heavy tails, which is none of a sample's fault."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy import stats

from mjfish.arrays import FloatArray
from mjfish.frames import CHANNELS, UNITS
from mjfish.inspection.finding import Finding
from mjfish.inspection.smooth import Smooth

#: Beyond this many sigma a sample is far out.
FAR = 6.0
#: Chance of a dataset with nothing but noise of that shape to be complained of.
_LEVEL = 1e-4
#: An outlier smaller than this share of the channel's range is not worth a word.
_SMALL = 0.05
#: Share of far samples from which the tails are heavy: of normal noise there are 2e-9.
_HEAVY = 3e-4


def outliers(found: Sequence[Smooth]) -> Iterator[Finding]:
    """Judge the samples of all trials against the noise they are in.

    The misfits of all trials, in units of their sigma, are described by a Student t whose freedom their 97.5 % point
    gives, that a few outliers do not move. A sample beyond what that t reaches in so many samples is an outlier.
    """
    for channel, name in enumerate(CHANNELS):
        scaled = [one.misfit[:, channel] / one.sigma[channel] for one in found]
        if not scaled:
            return
        every = np.concatenate(scaled)
        freedom, spread = _student(every)
        far = float(stats.t.isf(0.5 * _LEVEL / len(every), freedom)) * spread
        limit = max(far, FAR)
        for one, values in zip(found, scaled, strict=True):
            size = np.abs(one.misfit[:, channel])
            out = np.flatnonzero((np.abs(values) > limit) & (size > _SMALL * np.ptp(one.trial.velocity[:, channel])))
            # Beside an outlier the line itself is bent.
            peaks = [int(k) for k in out if size[k] >= size[np.abs(one.rows - one.rows[k]) <= 3].max()]
            if peaks:
                yield _outlier(one, name, channel, peaks, values)
        share = float(np.mean(np.abs(every) > FAR))
        if share > _HEAVY and freedom < 10.0:
            yield Finding(
                "outliers",
                "remark",
                f"channel {name}",
                f"the noise has heavy tails: {share:.2%} of the samples are beyond {FAR:g} sigma, as a Student t of "
                f"{freedom:.1f} degrees of freedom has them",
                "normal noise, with none",
                "p values are then a little too small and weak causes harder to see; look for lost markers",
                channels=(name,),
            )


def _outlier(one: Smooth, name: str, channel: int, peaks: Sequence[int], values: FloatArray) -> Finding:
    worst = max(peaks, key=lambda k: abs(values[k]))
    row = int(one.rows[worst])
    others = f" and {len(peaks) - 1} more" if len(peaks) > 1 else ""
    return Finding(
        "outliers",
        "suspect",
        f"trial '{one.trial.name}', {name}, row {row + 1} ({one.trial.time[row]:.3f} s){others}",
        f"{one.trial.velocity[row, channel]:.4g} {UNITS[name]} is {abs(values[worst]):.0f} sigma off the line through "
        "its neighbours",
        f"samples within what the noise of the other {len(values) - len(peaks)} reaches",
        "remove these rows and say gaps = true, or correct them at the source",
        trials=(one.trial.name,),
        channels=(name,),
    )


def _student(values: FloatArray) -> tuple[float, float]:
    """Return freedom and scale of the Student t with the median and the 97.5 % point of |values|."""
    half, high = np.quantile(np.abs(values), [0.5, 0.975])
    ratio = float(high / max(half, 1e-300))
    grid = np.concatenate([np.arange(1.0, 5.0, 0.25), np.arange(5.0, 31.0), [100.0]])
    ratios = stats.t.ppf(0.9875, grid) / stats.t.ppf(0.75, grid)
    freedom = float(np.interp(-ratio, -ratios, grid))
    return freedom, float(half / stats.t.ppf(0.75, freedom))
