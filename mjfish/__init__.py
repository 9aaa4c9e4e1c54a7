"""mjfish: what a swimming-fish simulation gets wrong, why, and what knowing it gains.

A fish swims (drive -> body -> water -> camera), a measured fish swims too, and the package explains the difference.
The names below are imported when they are first used:

- the fish, the data and the model: `Fish`, `load_fish`, `new_fish`, `Dataset`, `Trial`, `load_dataset`, `Model`,
  `Effect`, `Parameter`;
- what can be done with them: `simulate`, `generate`, `check`, `inspect`, `identify`, `diagnose`, `load_diagnosis`,
  `sample`, `plan`, `compare`;
- the water for any MuJoCo model: `StripFluid`, `StripLink`, `BluntLink`;
- `MjfishError`, the base of every error that a wrong input raises.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from importlib.metadata import version

    from mjfish.comparison import compare
    from mjfish.data import Dataset, Trial, load_dataset
    from mjfish.design import plan
    from mjfish.diagnosis import diagnose, load_diagnosis
    from mjfish.effects import Effect
    from mjfish.errors import MjfishError
    from mjfish.estimation import identify
    from mjfish.fish import Fish, load_fish
    from mjfish.fish.from_measurements import new_fish
    from mjfish.inspection import inspect
    from mjfish.model import Model
    from mjfish.model.posterior import sample
    from mjfish.mujoco import BluntLink, StripFluid, StripLink
    from mjfish.parameters import Parameter
    from mjfish.simulation import check, generate, simulate

    __version__ = version("mjfish")

#: Where each public name is defined.
_HOME = {
    "BluntLink": "mujoco",
    "Fish": "fish",
    "load_fish": "fish",
    "new_fish": "fish.from_measurements",
    "Dataset": "data",
    "Trial": "data",
    "load_dataset": "data",
    "Model": "model",
    "Effect": "effects",
    "Parameter": "parameters",
    "StripFluid": "mujoco",
    "StripLink": "mujoco",
    "simulate": "simulation",
    "generate": "simulation",
    "check": "simulation",
    "inspect": "inspection",
    "identify": "estimation",
    "diagnose": "diagnosis",
    "load_diagnosis": "diagnosis",
    "sample": "model.posterior",
    "plan": "design",
    "compare": "comparison",
    "MjfishError": "errors",
}

__all__ = [
    "BluntLink",
    "Dataset",
    "Effect",
    "Fish",
    "MjfishError",
    "Model",
    "Parameter",
    "StripFluid",
    "StripLink",
    "Trial",
    "__version__",
    "check",
    "compare",
    "diagnose",
    "generate",
    "identify",
    "inspect",
    "load_dataset",
    "load_diagnosis",
    "load_fish",
    "new_fish",
    "plan",
    "sample",
    "simulate",
]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used: most of them need the compiler or MuJoCo."""
    if name == "__version__":
        from importlib.metadata import version

        return version("mjfish")
    if name not in _HOME:
        raise AttributeError(f"module 'mjfish' has no attribute '{name}'")
    value = getattr(importlib.import_module(f"mjfish.{_HOME[name]}"), name)
    if not isinstance(value, type):
        from mjfish.errors.arguments import checked

        value = checked(value)
        value.__module__ = __name__  # where pickle finds it
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
