"""Which MuJoCo the water needs; checked when the package is imported, before anything asks for a name."""

from __future__ import annotations

import functools

import mujoco

from mjfish.errors import MjfishError

#: The oldest MuJoCo, and what it has that those before have not.
OLDEST = "3.13"
_NEWEST_NAMES = ("mjtIntegrator.mjINT_DISCRETE", "mj_fullM", "MjSpec")


def check() -> None:
    """Refuse a MuJoCo without what is needed.

    Raises:
        MjfishError: naming the version, what it lacks and what to install.
    """
    absent = [
        name
        for name in _NEWEST_NAMES
        if functools.reduce(lambda found, part: getattr(found, part, None), name.split("."), mujoco) is None
    ]
    if absent:
        raise MjfishError(
            f"MuJoCo {mujoco.__version__} has no {', '.join(absent)}, expected MuJoCo {OLDEST} or later; "
            f"install it: pip install 'mujoco>={OLDEST}'"
        )


check()
