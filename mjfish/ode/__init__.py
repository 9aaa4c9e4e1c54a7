"""The standalone engine: head-frame Newton-Euler equations of [Yu2016], (1)-(19), compiled."""

from mjfish.ode.rollout import Rollout, simulate

__all__ = ["Rollout", "simulate"]
