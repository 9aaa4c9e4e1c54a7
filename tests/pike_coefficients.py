"""Names of the coefficients of the pike."""

from __future__ import annotations

from mjfish.fish import load_fish

#: c_m, c_d, c_f of head, body, tail: the nine of [Yu2016], Table III, in its order.
COEFFICIENTS = load_fish("pike").coefficient_names
