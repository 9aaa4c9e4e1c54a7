"""Rate of the added momentum of a link, for forces that go with it: a load knows velocities only.

Three lags in a row stand for the derivative of the momentum p; with D_1 = (p - a) / tau,

    a' = D_1,    b' = (D_1 - b) / tau,    c' = (b - c) / tau,    p' ~ 3 D_1 - 3 b + c,    a = b = c = 0 at the start.

Its frequency response is i w (1 - (i w tau / (1 + i w tau))^3): off by (w tau)^3, 0.5 % at 3 Hz, where one lag is off
by w tau, 17 %. A jump of the momentum comes out whole, spread over some tau; so does what a run begins with.
"""

from __future__ import annotations

from mjfish.compiled import merged

#: Of the lags [s]. An added mass of e times what a link has already, acting through them, is stable for -8/9 < e, and
#: under Runge-Kutta steps of 5 ms for e <= 1.
SETTLE = 0.009


@merged
def momentum_rate(momentum: float, a: float, b: float, c: float) -> tuple[float, float, float, float]:
    """Return p' and the rates of a, b and c."""
    rate = (momentum - a) / SETTLE
    return 3.0 * (rate - b) + c, rate, (rate - b) / SETTLE, (b - c) / SETTLE
