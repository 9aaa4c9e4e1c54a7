"""Rate of the added momentum of a link, for forces that go with it: a load knows velocities only.

Three lags in a row stand for the derivative of the momentum p; with D_1 = (p - a) / tau,

    a' = D_1,    b' = (D_1 - b) / tau,    c' = (b - c) / tau,    p' ~ 3 D_1 - 3 b + c,    a = b = c = 0 at the start.

Its frequency response is i w (1 - (i w tau / (1 + i w tau))^3): off by (w tau)^3, 0.5 % at 3 Hz, where one lag is off
by w tau, 17 %. A jump of the momentum comes out whole, spread over some tau; so does what a run begins with.
"""

from __future__ import annotations

from typing import Any

from mjfish.effects.beat_amplitude import TAU
from mjfish.numerics.compiled import merged

#: Of the lags [s]. An added mass of e times what a link has already, acting through them, is stable for -8/9 < e, and
#: under Runge-Kutta steps of 5 ms for e <= 1.
SETTLE = 0.009


@merged
def momentum_rate(momentum: float, a: float, b: float, c: float) -> tuple[float, float, float, float]:
    """Return p' and the rates of a, b and c."""
    rate = (momentum - a) / SETTLE
    return 3.0 * (rate - b) + c, rate, (rate - b) / SETTLE, (b - c) / SETTLE


@merged
def added_mass_excess(link: Any, excess: float) -> tuple[float, ...]:
    """Return the force of a share `excess` of the added mass of a link, and the rates of its memory (8,).

    The memory is y and s of `mjfish.effects.beat_amplitude`, then the lags of the momentum across and of the turning
    one.
    """
    way, square = link.memory[0], link.memory[1]
    momentum = link.c_m * (link.added[0] * link.v + link.added[1] * link.w)
    turning = link.c_m * (link.added[1] * link.v + link.added[2] * link.w)
    rate, a, b, c = momentum_rate(momentum, link.memory[2], link.memory[3], link.memory[4])
    turn_rate, turn_a, turn_b, turn_c = momentum_rate(turning, link.memory[5], link.memory[6], link.memory[7])
    return (
        excess * link.w * momentum,
        -excess * rate,
        -excess * (turn_rate + link.munk * link.u * momentum),
        link.v + 0.5 * link.length * link.w - way / TAU,
        (way * way - square) / TAU,
        a,
        b,
        c,
        turn_a,
        turn_b,
        turn_c,
    )
