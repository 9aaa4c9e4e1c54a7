"""The catalogue of causes: one file, one class, one cause.

To add a cause, add a file with a subclass of `Effect`; nothing else changes. A user's own file works the same.
"""

from mjfish.effects.catalogue import Causes, catalogue, find, of_fish
from mjfish.effects.effect import Effect, Fingerprint

__all__ = ["Causes", "Effect", "Fingerprint", "catalogue", "find", "of_fish"]
