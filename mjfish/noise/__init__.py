"""Noise of measured velocities as the tests see it: coloured, with missing samples, through forces on the fish."""
