"""Numbers that a fit may change, and what is known of them before it."""

from mjfish.parameters.parameter import Parameter, bounds

__all__ = ["Parameter", "bounds"]
