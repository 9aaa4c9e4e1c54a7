"""The MuJoCo engine: any model in water, and the fish in it. Nothing else imports MuJoCo.

In reading order:

* `supported`: which MuJoCo this needs.
* `links`: what the water must know of a body; `custom_numerics`: the same in an MJCF.
* `fluid`: `StripFluid`, water on bodies of any model; `coupling_choice`: which coupling is right for which model.
* `link_force`: the force on one link; `coupling`: added mass in the equation of motion.
* `memory`: hidden states of loads.
* `block`, `layout`, `callback`, `written_forces`: how compiled code finds the water, MuJoCo's memory and its way back.
* `mjcf`: the fish as a MuJoCo model; `rollout`: runs with servos; `export`: files.
* `offscreen`: pictures without a window; `viewer`: MuJoCo's own, with sliders.
"""

from mjfish.mujoco import supported  # isort: skip  # first: the others import names that an older MuJoCo has not
from mjfish.mujoco.fluid import StripFluid
from mjfish.mujoco.links import BluntLink, StripLink
from mjfish.mujoco.mjcf import Trim
from mjfish.mujoco.rollout import SimRollout, simulate

__all__ = ["BluntLink", "SimRollout", "StripFluid", "StripLink", "Trim", "simulate", "supported"]
