"""Forms that nobody coded in the catalogue: mechanisms as others would write them, drawn at random.

Half of the cases of a mechanism whose form is a curve (drag, lift) have a random function.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mjfish.numerics.arrays import FloatArray
from studies.battery.generator.causes import Cause, Draw
from studies.battery.generator.other_water import FIRST_KNOT, FORMS, HARMONICS, KNOT_STEP, KNOTS, REFERENCE_SPEED, curve

#: Strength of a weak case, and range of the medium ones.
WEAK, MEDIUM = 40.0, (100.0, 400.0)
#: Of each of a pair.
PAIRED = (100.0, 1000.0)


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def gaussian_process(rng: np.random.Generator, length: float) -> FloatArray:
    """Return values (KNOTS,) of a Gaussian process in the logarithm of the speed, variance 1."""
    x = FIRST_KNOT + KNOT_STEP * np.arange(KNOTS)
    values, axes = np.linalg.eigh(np.exp(-0.5 * (np.subtract.outer(x, x) / length) ** 2))
    return np.asarray(axes @ (np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal(KNOTS)))


def _random_drag(rng: np.random.Generator) -> dict[str, float]:
    length = _log_uniform(rng, 0.5, 2.0)
    across, along = gaussian_process(rng, length), rng.uniform(0.3, 1.0) * gaussian_process(rng, length)
    knots = {f"random_drag.across_{k}": float(value) for k, value in enumerate(across)}
    knots |= {f"random_drag.along_{k}": float(value) for k, value in enumerate(along)}
    return {"random_drag.size": _log_uniform(rng, 0.1, 0.5), **knots}


def _reynolds_decay(rng: np.random.Generator) -> dict[str, float]:
    share = rng.uniform(0.0, 1.0)
    return {
        "reynolds_decay.friction": 0.7 * share,
        "reynolds_decay.pressure": 0.7 * (1.0 - share),
        "reynolds_decay.number": _log_uniform(rng, 1.5e4, 8e4),
    }


def _whole_speed_power(rng: np.random.Generator) -> dict[str, float]:
    share, sign = rng.uniform(0.0, 1.0), _sign(rng)
    return {"whole_speed_power.friction": 0.2 * sign * share, "whole_speed_power.pressure": 0.2 * sign * (1.0 - share)}


def _cubic_drag(rng: np.random.Generator) -> dict[str, float]:
    del rng
    return {"cubic_drag.size": 0.1}


def _drag_crisis(rng: np.random.Generator) -> dict[str, float]:
    return {
        "drag_crisis.size": 0.3,
        "drag_crisis.share": float(rng.uniform(0.0, 1.0)),
        "drag_crisis.across": _log_uniform(rng, 0.2, 0.8),
        "drag_crisis.along": _log_uniform(rng, 0.1, 0.4),
        "drag_crisis.width": float(rng.uniform(0.2, 0.6)),
    }


def _stalling_fin(rng: np.random.Generator) -> dict[str, float]:
    return {
        "stalling_fin.slope": 0.15,
        "stalling_fin.stall": float(rng.uniform(0.1, 0.7)),
        "stalling_fin.place": float(rng.uniform(0.2, 0.6)),
    }


def _body_stream_lift(rng: np.random.Generator) -> dict[str, float]:
    return {"body_stream_lift.slope": 0.1, "body_stream_lift.place": float(rng.uniform(0.2, 0.5))}


def _random_lift(rng: np.random.Generator) -> dict[str, float]:
    series = rng.standard_normal(HARMONICS) / np.arange(1.0, HARMONICS + 1.0)
    return {
        "random_lift.size": 0.2,
        "random_lift.place": float(rng.uniform(0.2, 0.6)),
        **{f"random_lift.harmonic_{k + 1}": float(value) for k, value in enumerate(series)},
    }


def _shed_momentum(rng: np.random.Generator) -> dict[str, float]:
    del rng
    return {"shed_momentum.share": 0.1}


def _munk_of_body(rng: np.random.Generator) -> dict[str, float]:
    return {"munk_of_body.kappa": 0.2 * _sign(rng)}


def _plant_with_inertia(rng: np.random.Generator) -> dict[str, float]:
    return {"plant_with_inertia.delay": 0.01, "plant_with_inertia.damping": float(rng.uniform(0.3, 1.2))}


def _limited_loop(rng: np.random.Generator) -> dict[str, float]:
    return {"limited_loop.slowness": 0.1, "limited_loop.lag": _log_uniform(rng, 0.004, 0.04)}


def _two_lags(rng: np.random.Generator) -> dict[str, float]:
    first, second, dead = rng.dirichlet([2.0, 2.0, 2.0])
    return {
        "two_lags.first": 0.02 * float(first),
        "two_lags.second": 0.02 * float(second),
        "two_lags.dead": 0.02 * float(dead),
    }


def _limit_then_lag(rng: np.random.Generator) -> dict[str, float]:
    del rng
    return {"limit_then_lag.slowness": 0.1}


def _cubic_tail(rng: np.random.Generator) -> dict[str, float]:
    return {
        "cubic_tail.compliance": 0.05,
        "cubic_tail.damping": float(rng.uniform(0.05, 0.18)),
        "cubic_tail.hardening": _log_uniform(rng, 20.0, 150.0),
    }


def _stiffening_tail(rng: np.random.Generator) -> dict[str, float]:
    return {
        "stiffening_tail.compliance": 0.05,
        "stiffening_tail.damping": float(rng.uniform(0.05, 0.18)),
        "stiffening_tail.gain": float(rng.uniform(1.0, 5.0)),
        "stiffening_tail.bend": float(rng.uniform(0.03, 0.12)),
    }


def _roll_slip(rng: np.random.Generator) -> dict[str, float]:
    return {
        "roll_slip.size": 1.0,
        "roll_slip.frequency": float(rng.uniform(5.0, 14.0)),
        "roll_slip.damping": float(rng.uniform(0.1, 0.4)),
    }


_SERIES = tuple(f"random_lift.harmonic_{k + 1}" for k in range(HARMONICS))
_CURVES = tuple(f"random_drag.{side}_{k}" for side in ("across", "along") for k in range(KNOTS))


def _form(name: str, draw: Draw, low: float, high: float, twins: tuple[str, ...] = (), shapes: str = "") -> Cause:
    own = tuple(f"{name}.{short}" for short in shapes.split())
    series = {"random_lift": _SERIES, "random_drag": _CURVES}.get(name, ())
    return Cause(name, draw, low, high, exact=False, listed=False, shapes=(*own, *series), series=series, twins=twins)


#: By mechanism; twins are the names of the catalogue for the same law. Servos and tails are seen however small: their
#: least sizes are such that the form is seen too.
BY_MECHANISM: Mapping[str, tuple[Cause, ...]] = {
    "drag_law": (
        _form("random_drag", _random_drag, 0.0, 12.0),
        _form("reynolds_decay", _reynolds_decay, 0.0, 25.0, ("exponential_drag",), "number"),
        _form("whole_speed_power", _whole_speed_power, 0.0, 4.5),
        _form("cubic_drag", _cubic_drag, 0.0, 50.0),
        _form("drag_crisis", _drag_crisis, 0.0, 12.0, (), "share across along width"),
    ),
    "lift": (
        _form("random_lift", _random_lift, 0.0, 30.0, (), "place"),
        _form("stalling_fin", _stalling_fin, 0.0, 30.0, (), "stall place"),
        _form("body_stream_lift", _body_stream_lift, 0.0, 40.0, (), "place"),
    ),
    "reactive_force": (
        _form("shed_momentum", _shed_momentum, 0.0, 12.0, ("edge_momentum",)),
        _form("munk_of_body", _munk_of_body, 0.0, 8.0),
    ),
    "servo_dynamics": (
        _form("plant_with_inertia", _plant_with_inertia, 1.0, 20.0, ("servo_second_order",), "damping"),
        _form("limited_loop", _limited_loop, 0.8, 5.0, ("servo_limited_lag",)),
        _form("two_lags", _two_lags, 1.0, 10.0),
        _form("limit_then_lag", _limit_then_lag, 0.8, 5.0),
    ),
    "tail_flexibility": (
        _form("cubic_tail", _cubic_tail, 1.0, 60.0, ("tail_hardening",), "damping hardening"),
        _form("stiffening_tail", _stiffening_tail, 1.0, 60.0, (), "damping gain bend"),
    ),
    "roll": (_form("roll_slip", _roll_slip, 0.0, 30.0, ("roll_loss",), "frequency damping"),),
}
FOREIGN = tuple(cause for forms in BY_MECHANISM.values() for cause in forms)
#: Random functions.
RANDOM = ("random_drag", "random_lift")


def draw_form(rng: np.random.Generator) -> str:
    """Draw a mechanism, then a form: a random function half of the time where there is one."""
    forms = [cause.name for cause in BY_MECHANISM[str(rng.choice(list(BY_MECHANISM)))]]
    free = [name for name in forms if name in RANDOM]
    if free and rng.random() < 0.5:
        return free[0]
    return str(rng.choice([name for name in forms if name not in free]))


def draw_strength(rng: np.random.Generator) -> float:
    """Draw a strength: weak or medium."""
    return WEAK if rng.random() < 0.5 else _log_uniform(rng, *MEDIUM)


def draw_pair_strength(rng: np.random.Generator) -> float:
    """Draw the strength of one of a pair."""
    return _log_uniform(rng, *PAIRED)


#: Numbers of the forms of the water's force, in the order of the kernel.
_ORDER = {
    "random_drag": ("size", *(f"{side}_{k}" for side in ("across", "along") for k in range(KNOTS))),
    "reynolds_decay": ("friction", "pressure", "number"),
    "whole_speed_power": ("friction", "pressure"),
    "drag_crisis": ("size", "share", "across", "along", "width"),
    "random_lift": ("size", "place", *(f"harmonic_{k + 1}" for k in range(HARMONICS))),
    "stalling_fin": ("slope", "stall", "place"),
    "body_stream_lift": ("slope", "place"),
    "shed_momentum": ("share",),
    "munk_of_body": ("kappa",),
}


def water(psi: Mapping[str, float]) -> dict[str, float]:
    """Return the numbers of the kernel that a foreign form changes."""
    given: dict[str, float] = {}
    for name, order in _ORDER.items():
        if f"{name}.{order[0]}" in psi:
            given["form"] = float(FORMS[name])
            given |= {f"form_{k}": psi[f"{name}.{short}"] for k, short in enumerate(order)}
    for name in ("cubic_tail", "stiffening_tail"):
        if psi.get(f"{name}.compliance"):
            given |= {"stiffness": 1.0 / psi[f"{name}.compliance"], "damping": psi[f"{name}.damping"]}
            more = {short: psi.get(f"{name}.{short}") for short in ("hardening", "gain", "bend")}
            given |= {f"tail_{short}": value for short, value in more.items() if value is not None}
    if psi.get("roll_slip.size"):
        given |= {f"slip_{short}": psi[f"roll_slip.{short}"] for short in ("size", "frequency", "damping")}
    return given


def drag_factor(psi: Mapping[str, float], speed: FloatArray) -> FloatArray | None:
    """Return c_d over the coefficient, by the local speed across (n,) [m/s]; None where it is no function of that."""
    w = [psi.get(f"random_drag.{short}", 0.0) for short in _ORDER["random_drag"]]
    if psi.get("random_drag.size"):
        values = [curve(np.log(s / REFERENCE_SPEED), np.array(w), 1) for s in speed]
        return np.asarray(np.exp(w[0] * np.array(values)))
    if psi.get("drag_crisis.size"):
        at, width = psi["drag_crisis.across"], psi["drag_crisis.width"]
        return np.asarray(1.0 + psi["drag_crisis.size"] / (1.0 + (speed / at) ** (2.0 / width)))
    return None
