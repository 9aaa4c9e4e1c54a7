"""How work is done: side by side in threads or processes, within a time, with finished parts kept in a folder."""

from mjfish.execution.tasks import Execution, completed, executing, execution, in_order, mapped

__all__ = ["Execution", "completed", "executing", "execution", "in_order", "mapped"]
