"""The MuJoCo engine: any model in water, and the fish in it. Nothing else imports MuJoCo."""

from mjfish.sim.fluid import StripFluid
from mjfish.sim.free import Trim
from mjfish.sim.rollout import SimRollout, simulate
from mjfish.sim.strip_link import StripLink

__all__ = ["SimRollout", "StripFluid", "StripLink", "Trim", "simulate"]
