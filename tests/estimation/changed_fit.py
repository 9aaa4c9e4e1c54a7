"""Fits with another residual, or other derivatives, than those that were found."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from mjfish.estimation import Fit
from mjfish.numerics.sized_cache import always


def having(fit: Fit, **other: Any) -> Fit:
    """Return a fit with other attributes, `residual`, `jacobian` and `covariance` among them."""
    if "residual" in other:
        other["residuals"] = always(other.pop("residual"))
    large = {name: other.pop(name) for name in ("jacobian", "covariance") if name in other}
    if large:
        other["linearised"] = always(replace(fit.linearised(), **large))
    return replace(fit, **other)
