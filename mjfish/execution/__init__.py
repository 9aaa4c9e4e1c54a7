"""How work is done: side by side in threads or processes, within a time, with finished parts kept in a folder."""

from mjfish.execution.tasks import (
    Execution,
    PastLimitError,
    check_time,
    completed,
    executing,
    execution,
    in_order,
    limited,
    mapped,
)

__all__ = [
    "Execution",
    "PastLimitError",
    "check_time",
    "completed",
    "executing",
    "execution",
    "in_order",
    "limited",
    "mapped",
]
