"""Forms as curves: what a fitted mechanism makes of a coefficient, with its band and where the runs have been.

A curve is read off the forces themselves: a link alone is moved through the water, and its force is divided by what
stands beside the coefficient in the textbook. So a learned form and a formula are drawn alike. The band is that of the
linearised fit, y +- 1.96 sqrt(g' C g) with the gradient g of y by the parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
from scipy.integrate import cumulative_simpson
from scipy.signal import lfilter

from mjfish.data import Trial
from mjfish.diagnosis.refit_result import Refit
from mjfish.diagnosis.table import linearised
from mjfish.drive.motion import JointMotion
from mjfish.effects.beat_amplitude import KC_FLOOR, TAU, keulegan_carpenter
from mjfish.estimation import Fit
from mjfish.estimation.marginal_likelihood import effective_degrees_of_freedom
from mjfish.fish import Fish
from mjfish.fish.outline import outlines
from mjfish.hydro.force import drag
from mjfish.hydro.forced_motion import forced_motion
from mjfish.hydro.link import link_records
from mjfish.hydro.load import ANSWER, LoadBuffers, LoadTable, load_rows, loads_on
from mjfish.model import Model
from mjfish.model.model import Prepared, driven, requested_motion
from mjfish.numerics.arrays import FloatArray, RecordArray
from mjfish.numerics.formats import number, unit
from mjfish.ode.forces import link_velocities

#: Shares of the information between which a variable counts as visited.
_VISITED = (0.02, 0.98)
#: Points of a curve.
_POINTS = 25
#: Effective degrees of freedom below which a learned curve is nothing, and below which it is one number; ratio of the
#: ends of the visited range below which it is one number, too.
_NUMBER, _CURVE, _NARROW = 0.5, 1.5, 1.5
#: Step of a forced motion [s].
_STEP = 0.005
#: Steps in a beat of a link that is swung, and number of beats, till its amplitude is known; and steps of a motion that
#: begins at once and goes on.
_BEAT, _BEATS, _SETTLED = 80, 10, 200


@dataclass(frozen=True)
class Axis:
    """Name and unit of what stands at an axis, with its values."""

    name: str
    unit: str
    values: tuple[float, ...]


@dataclass(frozen=True)
class Band(Axis):
    """An axis with the 95 % band of its values."""

    low: tuple[float, ...]
    high: tuple[float, ...]


@dataclass(frozen=True)
class MeasuredCurve:
    """One curve of a form.

    Attributes:
        quantity: what the form gives.
        group: of the links that have it.
        x, y: what stands at the axes; y with its band.
        nominal: y of the nominal model, at the same x.
        visited: smallest and largest x where the runs say something of y; both zero where they say nothing.
        degrees_of_freedom: how many numbers of a learned curve the runs determine; None of a formula.
    """

    quantity: str
    group: str
    x: Axis
    y: Band
    nominal: tuple[float, ...]
    visited: tuple[float, float]
    degrees_of_freedom: float | None = None

    @property
    def bears(self) -> Literal["curve", "number", "nothing"]:
        """What the runs bear of it: a curve, one number where they determine no second one, or nothing.

        A range of x that is narrower than a factor of 1.5 bears one number.
        """
        known = np.inf if self.degrees_of_freedom is None else self.degrees_of_freedom
        if self.seen is None or known < _NUMBER:
            return "nothing"
        narrow = self.seen[0] > 0.0 and self.seen[1] < _NARROW * self.seen[0]
        return "number" if known < _CURVE or narrow else "curve"

    @property
    def seen(self) -> tuple[float, float] | None:
        """The visited range as far as the curve reaches; None where the runs say nothing of it."""
        low, high = max(self.visited[0], self.x.values[0]), min(self.visited[1], self.x.values[-1])
        return (low, high) if high > low else None

    def at(self, x: float) -> tuple[float, float, float]:
        """Return y and both ends of its band at x, linear between the points of the curve."""
        y, low, high = (float(np.interp(x, self.x.values, v)) for v in (self.y.values, self.y.low, self.y.high))
        return y, low, high

    def summary(self) -> str:
        """Return one line: y with its band at both ends of the visited range."""
        name = f"{self.quantity} of {self.group}"
        if self.seen is None or self.bears == "nothing":
            return f"{name}: the runs say nothing of it"
        if self.bears == "number":
            return f"{name}: {self._told(0.5 * sum(self.seen))}, one number: the runs bear no curve"
        ends = (f"{self._told(x)} at {number(x, 2)} {self.x.unit}" for x in self.seen)
        return f"{name}: {', '.join(ends)}"

    def _told(self, x: float) -> str:
        y, low, high = map(number, self.at(x))
        return f"{y} ({low} to {high}) {unit(self.y.unit)}".rstrip()


@dataclass(frozen=True, eq=False)
class _Form:
    """A curve before it is measured: its value (n,) at x (n,) for a fish with causes, and where the runs have been."""

    quantity: str
    group: str
    x: tuple[str, str]
    y: tuple[str, str]
    at: FloatArray
    value: Callable[[_Fish, FloatArray], FloatArray]
    visits: tuple[FloatArray, FloatArray]


def curves_of(mechanism: str, refit: Refit, nominal: Fit) -> tuple[MeasuredCurve, ...]:
    """Return the curves of a mechanism in a fitted model; none where its form is no function of one variable.

    Args:
        mechanism: its name.
        refit: with a cause of that mechanism.
        nominal: fit of the nominal model.
    """
    make = _FORMS.get(mechanism)
    return () if make is None else tuple(_measured(form, mechanism, refit, nominal) for form in make(refit))


def _measured(form: _Form, mechanism: str, refit: Refit, before: Fit) -> MeasuredCurve:
    own = tuple(effect for effect in refit.effects if effect.mechanism == mechanism)
    model, trial = Model(refit.problem.model.fish, own), refit.problem.trials[0]

    def at(values: Mapping[str, float]) -> FloatArray:
        return form.value(_Fish.of(model, values, trial), form.at)

    y, half, slopes = linearised(refit.fit, model.parameters, at)
    nominal = form.value(_Fish.of(Model(model.fish, ()), before.values, trial), form.at)
    knots = {p.name for effect in own if effect.learned for p in effect.parameters}
    moving = [name for name, slope in slopes.items() if name in knots and np.any(slope)]
    return MeasuredCurve(
        form.quantity,
        form.group,
        Axis(*form.x, tuple(map(float, form.at))),
        Band(*form.y, tuple(map(float, y)), tuple(map(float, y - half)), tuple(map(float, y + half))),
        tuple(map(float, nominal)),
        _visited(*form.visits),
        effective_degrees_of_freedom(refit.problem, refit.fit, moving) if knots else None,
    )


@dataclass(frozen=True, eq=False)
class _Fish:
    """A fish with a cause: its body, records of its links, its effects, and their loads.

    Attributes:
        run: what is simulated.
        records: of its links.
        loads: table of the loads that know the velocity only.
    """

    run: Prepared
    records: RecordArray
    loads: LoadTable

    @classmethod
    def of(cls, model: Model, values: Mapping[str, float], trial: Trial) -> _Fish:
        """Return it with these values."""
        everything = {p.name: values.get(p.name, p.default) for p in model.parameters}
        run = model.prepare(trial, everything)
        table = load_rows([pair for pair in run.loads if not pair[0].stateful])
        return cls(run, link_records(run.fish, run.coefficients), table)

    def force(self, link: int, u: float, v: float) -> tuple[float, float]:
        """Return the force of the loads on a link that moves at u along and v across [N]."""
        self.records["u"], self.records["v"], self.records["w"] = u, v, 0.0
        fx, fy, _ = loads_on(
            self.records, link, link, self.loads, False, LoadBuffers(np.zeros(ANSWER), np.zeros(0), np.zeros(0))
        )
        return fx, fy

    def across(self, link: int, v: FloatArray) -> FloatArray:
        """Return the force across (n + 1,) [N] of all loads on a link moved across at v (2 n + 1,), at every step."""
        velocity = np.zeros((len(v), 3))
        velocity[:, 1] = v
        return forced_motion(self.records, link, self.run.loads, velocity, _STEP)[:, 1]


def _visited(x: FloatArray, weight: FloatArray) -> tuple[float, float]:
    """Return the x between which most of the weight lies; (0, 0) where nothing was visited."""
    if x.size == 0 or not weight.sum() > 0.0:
        return 0.0, 0.0
    order = np.argsort(x)
    share = np.cumsum(weight[order]) / weight.sum()
    low, high = (float(x[order][np.searchsorted(share, bound)]) for bound in _VISITED)
    return low, high


def _velocities(refit: Refit) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return u, v, w (n, links) of the links in all fitted trials."""
    problem, parts = refit.problem, []
    for trial in problem.trials:
        rollout = problem.prediction(trial, {**problem.fixed, **refit.fit.values}).rollout
        parts.append(np.stack(link_velocities(problem.model.fish, rollout)))
    u, v, w = np.concatenate(parts, axis=1)
    return u, v, w


def _drag(refit: Refit) -> Iterator[_Form]:
    """Return c_d of a link that moves across, and c_f of one that moves along, by its speed."""
    fish = refit.problem.model.fish
    u, v, w = _velocities(refit)
    fastest = float(np.quantile(np.abs(u), 0.999)), float(np.quantile(np.abs(v), 0.999))
    for kind, top in (("c_d", fastest[1]), ("c_f", fastest[0])):
        for group in dict.fromkeys(link.group for link in fish.links):
            own = [i for i, link in enumerate(fish.links) if link.group == group]
            if kind == "c_f":
                speed = np.abs(u[:, own])
            else:
                pairs = zip(own, [outlines(fish)[i].coarse_r for i in own], strict=True)
                speed = np.abs(np.concatenate([v[:, i, None] + w[:, i, None] * r for i, r in pairs], axis=1))
            at = np.geomspace(0.02 * top, 1.5 * top, _POINTS)
            yield _Form(
                kind, group, ("speed", "m/s"), (kind, "-"), at, partial(_coefficient, kind, own[0]),
                (speed.ravel(), speed.ravel() ** 4),
            )  # fmt: skip


def _coefficient(kind: str, link: int, fish: _Fish, speeds: FloatArray) -> FloatArray:
    outline = outlines(fish.run.fish)[link]
    area = outline.wetted if kind == "c_f" else outline.height_moment[-1, 0]
    found = []
    for speed in speeds:
        u, v = (speed, 0.0) if kind == "c_f" else (0.0, speed)
        force = np.add(fish.force(link, u, v), drag(fish.records[link])[:2])[0 if kind == "c_f" else 1]
        found.append(-2.0 * force / (fish.run.fish.density * area * speed**2))
    return np.array(found)


def _lift(refit: Refit) -> Iterator[_Form]:
    """Return the coefficient of the force across the chord of fin and body by the angle of attack, drag left out."""
    fish = refit.problem.model.fish
    u, v, w = _velocities(refit)
    last = len(fish.links) - 1
    for group, own in (("fin", [last]), ("body", list(range(last)))):
        arm = 0.5 * np.array([fish.links[i].length for i in own])
        across, along = np.abs(v[:, own] + arm * w[:, own]), np.abs(u[:, own])
        visits = np.arctan2(across, along).ravel(), ((along**2 + across**2) ** 2).ravel()
        at = np.linspace(0.0, 1.5, _POINTS)
        speed = float(np.sqrt(np.mean(along**2 + across**2)))
        yield _Form(
            "c_n", group, ("angle_of_attack", "rad"), ("c_n", "-"), at, partial(_normal, own[-1], speed), visits
        )  # fmt: skip


def _normal(link: int, speed: float, fish: _Fish, angles: FloatArray) -> FloatArray:
    pressure = 0.5 * fish.run.fish.density * outlines(fish.run.fish)[link].height_moment[-1, 0] * speed**2
    forces = [fish.force(link, -speed * np.cos(angle), speed * np.sin(angle))[1] for angle in angles]
    return np.asarray(-np.array(forces) / pressure)


def _tail(refit: Refit) -> Iterator[_Form]:
    """Return the moment of the tail's spring by its deflection."""
    problem, values = refit.problem, {**refit.problem.fixed, **refit.fit.values}
    rollouts = [problem.prediction(trial, values).rollout for trial in problem.trials]
    deflection = np.abs(np.concatenate([rollout.state[:, 0, 6] for rollout in rollouts]))
    at = np.linspace(0.0, 1.2 * max(float(np.nanquantile(deflection, 0.999)), 1e-6), _POINTS)
    visits = deflection[np.isfinite(deflection)], deflection[np.isfinite(deflection)] ** 2
    yield _Form("moment", "tail", ("deflection", "rad"), ("moment", "N m"), at, _moment, visits)


def _moment(fish: _Fish, deflection: FloatArray) -> FloatArray:
    tail = fish.run.fish
    if tail.tail_compliance <= 0.0:
        return np.zeros_like(deflection)
    stiffer = tail.tail_quadratic * deflection + tail.tail_hardening * deflection**2  # deflections are not negative
    return np.asarray(deflection * (1.0 + stiffer) / tail.tail_compliance)


def _added_mass(refit: Refit) -> Iterator[_Form]:
    """Return c_m of a link that is swung across, by the Keulegan-Carpenter number of its way."""
    problem, fish = refit.problem, refit.problem.model.fish
    lengths = np.array([link.length for link in fish.links])
    heights = _heights(fish)
    numbers, weights = [], []
    for trial in problem.trials:
        rollout = problem.prediction(trial, {**problem.fixed, **refit.fit.values}).rollout
        _, v, w = link_velocities(fish, rollout)
        middle, step = v + 0.5 * lengths * w, float(np.mean(np.diff(rollout.time)))
        square = _forgotten(_forgotten(middle, step) ** 2, step) / TAU
        numbers.append(np.vectorize(keulegan_carpenter)(square, heights))
        weights.append(np.gradient(middle, axis=0) ** 2)
    number, weight = np.concatenate(numbers), np.concatenate(weights)
    at = np.geomspace(0.4, 1.5 * float(np.quantile(number, 0.999)), _POINTS)
    for group in dict.fromkeys(link.group for link in fish.links):
        own = [i for i, link in enumerate(fish.links) if link.group == group]
        yield _Form(
            "c_m", group, ("keulegan_carpenter_number", "-"), ("c_m", "-"), at, partial(_inertia, own[0], fish),
            (number[:, own].ravel(), weight[:, own].ravel()),
        )  # fmt: skip


def _heights(fish: Fish) -> FloatArray:
    """Return the heights (links,) of the links in the mean square [m]."""
    added = np.array([outline.added[0] for outline in outlines(fish)])
    return np.sqrt(4.0 * added / (np.pi * fish.density * np.array([link.length for link in fish.links])))


def _forgotten(x: FloatArray, step: float) -> FloatArray:
    """Return the solution (n, links) of y' = x - y / tau from zero on, tau that of the amplitude of a beat."""
    decay = np.exp(-step / TAU)
    return np.asarray(lfilter([TAU * (1.0 - decay)], [1.0, -decay], x, axis=0))


def _inertia(link: int, nominal: Fish, fish: _Fish, numbers: FloatArray) -> FloatArray:
    """Return the part of the force on a swung link that goes with its acceleration, over that at c_m = 1."""
    height = float(_heights(nominal)[link])
    phase = np.pi * np.arange(2 * _BEAT * _BEATS + 1) / _BEAT
    rate = 2.0 * np.pi / (_BEAT * _STEP)
    last = slice(_BEAT * (_BEATS - 1), _BEAT * _BEATS)
    own = fish.records[link]
    found = []
    for kc in numbers:
        speed = rate * height * np.sqrt(max(kc**2 - KC_FLOOR**2, 1e-6)) / (2.0 * np.pi)
        force = fish.across(link, speed * np.cos(phase))[last]
        found.append(2.0 * float(np.mean(force * np.sin(phase[::2][last]))) / (rate * speed))
    return np.asarray((own["c_m"] * own["added"][0] + np.array(found)) / outlines(nominal)[link].added[0])


def _wake(refit: Refit) -> Iterator[_Form]:
    """Return c_d and c_m of a link that is set in motion at once and goes on, by the time since then."""
    fish = refit.problem.model.fish
    steps = np.unique(np.round(np.geomspace(2.0, _SETTLED, _POINTS)).astype(int))
    runs = [trial.time for trial in refit.problem.trials]
    times = np.geomspace(min(np.diff(time).min() for time in runs), max(np.ptp(time) for time in runs), 100)
    for kind in ("c_d", "c_m"):
        for group in dict.fromkeys(link.group for link in fish.links):
            own = next(i for i, link in enumerate(fish.links) if link.group == group)
            yield _Form(
                kind, group, ("time", "s"), (kind, "-"), steps * _STEP, partial(_response, kind, own, fish),
                (times, np.ones_like(times)),
            )  # fmt: skip


def _response(kind: str, link: int, nominal: Fish, fish: _Fish, times: FloatArray) -> FloatArray:
    """Return what there is of drag or added momentum some time after a link has been set in motion.

    Drag goes with the square of the speed, momentum with the speed: two speeds tell them apart.
    """
    still = np.ones(2 * _SETTLED + 1)
    once, twice = (fish.across(link, speed * still) for speed in (1.0, 2.0))
    own = fish.records[link]
    own["u"], own["v"], own["w"] = 0.0, 1.0, 0.0
    outline = outlines(nominal)[link]
    if kind == "c_m":
        impulse = cumulative_simpson(2.0 * once - 0.5 * twice, dx=_STEP, initial=0.0)
        found = (own["c_m"] * own["added"][0] - impulse) / outline.added[0]
    else:
        force = drag(own)[1] + 0.5 * twice - once
        found = -2.0 * force / (nominal.density * outline.height_moment[-1, 0])
    return np.asarray(found[np.round(times / _STEP).astype(int)])


def _servo_limit(refit: Refit) -> Iterator[_Form]:
    """Return the angle at which a joint ends, by the one that it is told."""
    model = refit.problem.model
    told = [np.abs(requested_motion(model.fish.cpg, trial, model.step).angle).ravel() for trial in refit.problem.trials]
    angle = np.concatenate(told)
    at = np.linspace(0.0, 1.1 * float(angle.max()), _POINTS)
    yield _Form("joint_angle", "joints", ("command", "rad"), ("joint_angle", "rad"), at, _reached, (angle, angle**2))


def _reached(fish: _Fish, command: FloatArray) -> FloatArray:
    angle = np.broadcast_to(command[:, None, None], (len(command), 3, 1))
    still = np.zeros_like(angle)
    motion = JointMotion(np.arange(len(command) + 1.0), angle, still, still)
    servos = tuple((effect, tuple(own.items())) for effect, own in fish.run.active)
    return driven(motion, servos).angle[:, 0, 0].copy()


#: By mechanism; others have forms that are numbers.
_FORMS: Mapping[str, Callable[[Refit], Iterator[_Form]]] = {
    "added_mass": _added_mass,
    "drag_law": _drag,
    "lift": _lift,
    "servo_limit": _servo_limit,
    "tail_flexibility": _tail,
    "wake_memory": _wake,
}
