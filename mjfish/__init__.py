"""mjfish: what a swimming-fish simulation gets wrong, why, and what knowing it gains.

A fish swims (drive -> body -> water -> camera), a measured fish swims too, and the package explains the difference:

- `mjfish.fish`, `mjfish.drive`, `mjfish.hydro`: the fish, its joint motion, the force of the water;
- `mjfish.ode`, `mjfish.mujoco`, `mjfish.simulation`: the head-frame equations, MuJoCo, one against the other;
- `mjfish.data`, `mjfish.data.importers`, `mjfish.simulation.generate`: measured, imported and planted datasets;
- `mjfish.effects`, `mjfish.model`, `mjfish.estimation`, `mjfish.diagnosis`: causes, the extended model, its fit,
  the verdict;
- `mjfish.comparison`: anyone's rollouts against measurements;
- `mjfish.reporting.html`, `mjfish.reporting.log`, `mjfish.cli`: how it is shown.

The water is there for any MuJoCo model, too: `mjfish.StripFluid`, described in `mjfish.mujoco`.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mjfish.mujoco import StripFluid, StripLink

__all__ = ["StripFluid", "StripLink"]


def __getattr__(name: str) -> Any:
    """Import MuJoCo and the compiler only for those who ask for the water."""
    if name not in __all__:
        raise AttributeError(f"module 'mjfish' has no attribute '{name}'")
    from mjfish import mujoco as sim

    return getattr(sim, name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
