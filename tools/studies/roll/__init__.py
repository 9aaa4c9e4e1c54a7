"""The roll of the free fish beside the planar one, written to docs/roll.md."""
