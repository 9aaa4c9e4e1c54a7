"""The MuJoCo engine: any model in water, and the fish in it. Nothing else imports MuJoCo."""

from mjfish.mujoco.fluid import StripFluid
from mjfish.mujoco.free import Trim
from mjfish.mujoco.rollout import SimRollout, simulate
from mjfish.mujoco.strip_link import StripLink

__all__ = ["SimRollout", "StripFluid", "StripLink", "Trim", "simulate"]
