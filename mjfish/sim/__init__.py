"""The MuJoCo engine: the planar fish with the water's force as a compiled callback. Nothing else imports MuJoCo."""

from mjfish.sim.callback import installed
from mjfish.sim.planar import model
from mjfish.sim.rollout import SimRollout, simulate

__all__ = ["SimRollout", "installed", "model", "simulate"]
