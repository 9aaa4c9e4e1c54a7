"""Command line: the only place that prints and exits. 0 good, 1 it ran and the outcome is not good, 2 misuse."""

from mjfish.cli.app import application, main

__all__ = ["application", "main"]
