"""The fish as the data know it: a Gaussian of its coefficients and effects, and draws of it.

A draw is the fish in another run: N(mean, covariance + (1 + 1 / runs) diag(scatter^2)), truncated to the bounds of the
parameters. To the error of the estimates comes the scatter from run to run (`mjfish.estimation.stability`): that of the
new run, and what the scatter of the fitted runs makes of their mean ([Higgins2009]). Without scatter, only the error is
left.

The draw is Gaussian in the parameters themselves, not in their logarithms: estimates often rest on a bound, and bounds
may be zero, where there is no logarithm. There the mean is the bound, and one parameter alone is drawn from a
half-normal distribution with the standard error that it would have without bounds, as its interval has it: wider than
the truth where the data push hard against the bound. Plain rejection would be the simplest way to truncate, but of five
estimates on bounds (as those of the paper's pike) it keeps one draw in thirty-two at best. So every draw comes from
elliptical slice sampling, which moves on ellipses inside the bounds and leaves the truncated Gaussian unchanged
([Murray2010]).

[Higgins2009] J. Higgins, S. Thompson, D. Spiegelhalter: A re-evaluation of random-effects meta-analysis, JRSS A 172.
[Murray2010] I. Murray, R. Adams, D. MacKay: Elliptical slice sampling, AISTATS.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from mjfish.data.columns import LARGEST
from mjfish.effects import Causes, catalogue, of_fish
from mjfish.effects.effect import Effect
from mjfish.errors import InputError, UnknownNameError
from mjfish.files import size_limited, tomlfile, writing
from mjfish.files.plain_data import plain
from mjfish.files.tomlfile import Table
from mjfish.fish import Fish
from mjfish.model import extended
from mjfish.model.extended import Extended
from mjfish.model.model import Model
from mjfish.numerics.arrays import FloatArray
from mjfish.parameters import bounds

#: Moves of every draw: of nine parameters of which seven rest on bounds, 200 forget where it began.
_MOVES = 1000
#: Halvings of an arc after which a draw stays where it is: bounds as near as rounding.
_HALVINGS = 60
#: Largest correlation that may be rounding.
_ROUNDED = 1.0 + 1e-6
#: Where draws begin: this share of a standard deviation inside the bounds, at most this share of their width.
_INSIDE, _INSIDE_WIDTH = 0.1, 0.25
_FILE = "diagnosis.json"
_REMEDY = "write it by 'mjfish diagnose DATASET --json FILE' or 'mjfish identify DATASET --json FILE' of this version"


class _Saved(Table):
    """The table ``posterior`` of a diagnosis or an identification."""

    fish: Fish
    effects: tuple[str, ...]
    names: tuple[str, ...]
    mean: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]
    scatter: tuple[float, ...]
    runs: int


@dataclass(frozen=True, eq=False)
class Posterior:
    """What a fit says of the parameters that all runs share.

    Attributes:
        model: the fish with its effects; its values and bounds are those of the fit.
        names: of the parameters that were fitted (p,).
        mean: their estimates (p,).
        covariance: of their errors (p, p). Estimates on a bound have the one that they would have without it, and
            bounds count as a Gaussian prior as wide as they are apart, so that what the data do not say stays finite.
            0 for coefficients for which learned curves stand in (`mjfish.estimation.intervals`).
        scatter: standard deviations (p,) from run to run.
        runs: how many were fitted.
    """

    model: Model
    names: tuple[str, ...]
    mean: FloatArray
    covariance: FloatArray
    scatter: FloatArray
    runs: int

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data: ``fish`` as its TOML has it, ``effects`` by name, the rest as above."""
        return {
            "fish": plain(self.model.fish.model_dump(by_alias=True)),
            "effects": [effect.name for effect in self.model.effects],
            **{name: plain(getattr(self, name)) for name in ("names", "mean", "covariance", "scatter", "runs")},
        }

    @classmethod
    def restored(cls, saved: object, place: str, effects: Mapping[str, Effect]) -> Posterior:
        """Return what `to_dict` made plain data of.

        Args:
            saved: the plain data.
            place: where it stands, for messages.
            effects: that may occur, by name.

        Raises:
            InputError: it is not what `to_dict` returns.
            UnknownNameError: an effect or a parameter is not known.
        """
        raw = tomlfile.parse(saved, _Saved, place)
        known = of_fish(effects, raw.fish)
        for name in raw.effects:
            if name not in known:
                raise UnknownNameError(f"effect in {place}", name, known, extended.OWN)
        model = Model(raw.fish, tuple(known[name] for name in raw.effects))
        declared = [p.name for p in model.parameters]
        for name in raw.names:
            if name not in declared:
                raise UnknownNameError(f"parameter in {place}", name, declared)
        count = len(raw.names)
        shapes = {len(raw.mean), len(raw.scatter), len(raw.covariance), *map(len, raw.covariance)}
        if shapes - {count} or raw.runs < 1:
            raise InputError(f"{place}: expected {count} numbers of each kind, one a name, and a run; {_REMEDY}")
        mean, covariance, scatter = (np.array(values) for values in (raw.mean, raw.covariance, raw.scatter))
        variance = np.diag(covariance)
        if (
            max(np.abs(covariance).max(initial=0.0), np.abs(scatter).max(initial=0.0)) > LARGEST
            or (variance < 0.0).any()
            or (np.abs(covariance) > _ROUNDED * np.sqrt(np.outer(variance, variance))).any()
        ):
            raise InputError(
                f"{place}: a negative variance, a correlation above 1, or a number above {LARGEST:g} in covariance or "
                f"scatter; {_REMEDY}"
            )
        return cls(model, raw.names, mean, covariance, scatter, raw.runs)

    def draw(self, n: int, rng: np.random.Generator) -> FloatArray:
        """Return parameters (n, p) of the fish in another run."""
        declared = {p.name: p for p in self.model.parameters}
        low, high = bounds([declared[name] for name in self.names])
        return truncated_normal(
            np.clip(self.mean, low, high),
            self.covariance + (1.0 + 1.0 / self.runs) * np.diag(self.scatter**2),
            low,
            high,
            n,
            rng,
        )


def truncated_normal(
    mean: FloatArray, covariance: FloatArray, low: FloatArray, high: FloatArray, n: int, rng: np.random.Generator
) -> FloatArray:
    """Return draws (n, p) of a Gaussian truncated to a box, each by a walk of its own.

    Args:
        mean: (p,) inside the box or on it.
        covariance: (p, p).
        low, high: (p,) of the box.
        n: how many.
        rng: generator of the draws.
    """
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    root = scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    inside = np.minimum(_INSIDE * np.sqrt(np.diag(covariance)), _INSIDE_WIDTH * (high - low))
    x = np.tile(np.clip(mean, low + inside, high - inside), (n, 1))
    for _ in range(_MOVES):
        other = rng.standard_normal(x.shape) @ root.T
        angle = rng.uniform(0.0, 2.0 * np.pi, n)
        first, last = angle - 2.0 * np.pi, angle.copy()
        moving = np.arange(n)
        start = x - mean
        for _ in range(_HALVINGS):
            at = angle[moving, None]
            point = mean + start[moving] * np.cos(at) + other[moving] * np.sin(at)
            held = np.all((low <= point) & (point <= high), axis=1)
            x[moving[held]] = point[held]
            moving = moving[~held]
            if moving.size == 0:
                break
            before = angle[moving] < 0.0
            first[moving[before]], last[moving[~before]] = angle[moving[before]], angle[moving[~before]]
            angle[moving] = rng.uniform(first[moving], last[moving])
    return x


@runtime_checkable
class Fitted(Protocol):
    """A result with a posterior: a diagnosis or an identification."""

    @property
    def posterior(self) -> Posterior | None:
        """What the fit says of the shared parameters; None where it diverged."""


def sample(
    diagnosis: Fitted | str | Path, n: int = 100, *, seed: int = 0, effects: Causes = None
) -> tuple[Extended, ...]:
    """Draw fish from the posterior of a diagnosis or an identification, for domain randomisation.

    A draw is the fish in another run: its coefficients and the parameters of its effects have the error of the fit and
    the scatter from run to run, and keep their bounds. Of a diagnosis it is the extended model, with the causes in
    `Diagnosis.best`; where there are none, the nominal one.

    Args:
        diagnosis: a `mjfish.diagnose` or `mjfish.identify` result, the JSON file of one, or a folder with
            ``diagnosis.json``.
        n: how many fish.
        seed: of the draws; the same seed gives the same fish.
        effects: that a file may have, by name, or Python files with causes of your own; None: the shipped ones.

    Returns:
        The fish with their effects, which `mjfish.simulate` takes.

    Raises:
        InputError: a file that cannot be read or has no posterior, a fit that diverged, or no draw asked for.
        UnknownNameError: an effect in the file is not known.

    Example:
        >>> import mjfish
        >>> pool = mjfish.generate("pike", ["v1", "v3-t1"], noise=(0.01, 0.01, 0.05), duration=6.0)
        >>> draws = mjfish.sample(mjfish.identify(pool, starts=1), 3)
        >>> [mjfish.simulate(draw, "v1", duration=1.0).status for draw in draws]
        ['ok', 'ok', 'ok']
    """
    if n < 1 or seed < 0:
        raise InputError(f"found {n} draws with seed {seed}, expected 1 or more with a seed of 0 or more; correct it")
    posterior = _read(diagnosis, catalogue(effects)) if isinstance(diagnosis, str | Path) else diagnosis.posterior
    if posterior is None:
        raise InputError("the fit diverged and has no posterior; look at its message, and fit again from another start")
    return tuple(
        Extended(posterior.model, dict(zip(posterior.names, map(float, x), strict=True)))
        for x in posterior.draw(n, np.random.default_rng(seed))
    )


def _read(source: str | Path, effects: Mapping[str, Effect]) -> Posterior:
    """Read the posterior in the JSON of a diagnosis or an identification."""
    path = Path(source) / _FILE if Path(source).is_dir() else Path(source)
    raw = size_limited.read_json(path, _REMEDY)
    saved = raw.get("posterior") if isinstance(raw, dict) else None
    if saved is None:
        raise InputError(f"{path}: has no posterior, as of a fit that diverged or another version; {_REMEDY}")
    return Posterior.restored(saved, f"{path}: posterior", effects)


def write_draws(folder: str | Path, draws: Sequence[Extended], comments: Sequence[str] = ()) -> tuple[Path, ...]:
    """Write draws as fish TOMLs ``draw_001.toml`` and so on to a new folder, all of them or none.

    Args:
        folder: absent or empty.
        draws: of `sample`.
        comments: lines at the top of every file.

    Returns:
        The files.

    Raises:
        InputError: the folder holds something or cannot be written.
    """
    folder = Path(folder)
    digits = max(3, len(str(len(draws))))
    names = [f"draw_{k:0{digits}d}.toml" for k in range(1, len(draws) + 1)]
    with writing.new_folder(folder) as partial:
        for name, draw in zip(names, draws, strict=True):
            extended.write(partial / name, draw.model, draw.values, comments)
    return tuple(folder / name for name in names)
