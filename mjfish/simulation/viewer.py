"""A fish with its effects in MuJoCo's viewer."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

from mjfish.drive.wave import Wave
from mjfish.effects import Causes
from mjfish.fish import Fish
from mjfish.model import extended
from mjfish.mujoco import Trim
from mjfish.mujoco.viewer import Player, Tank
from mjfish.simulation.run import prepared


def tank(
    fish: Fish | extended.Extended | str | Path = "pike",
    mode: str = "v1",
    *,
    values: Mapping[str, float] | None = None,
    effects: Causes = None,
    drive: Wave | str | Path | None = None,
    free: bool = False,
) -> Tank:
    """Return a fish in water for `mjfish.mujoco.viewer.show`; arguments and errors as of `mjfish.simulate`.

    The drive goes on with its last beat, a file of joint angles with all of it.
    """
    run, trial = prepared(fish, mode, values=values, effects=effects, drive=drive)
    if trial.drive:
        beat = 2.0 * math.pi / trial.drive[-1].omega
    elif trial.wave is not None:
        beat = 1.0 / trial.wave.frequency
    else:
        beat = float(run.motion.time[-1])
    player = Player(run.motion, min(beat, float(run.motion.time[-1])))
    return Tank(run.fish, player, values=run.coefficients, free=Trim() if free else None, loads=run.loads)
