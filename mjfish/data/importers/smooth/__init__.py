"""A batch smoother: all frames of a run at once, coordinates as splines plus harmonics of the beat, noise by evidence.

The basis of a coordinate (`basis`), what is observed of the coordinates (`observation`: markers of a chain in `chain`,
or the coordinates themselves), the fit (`batch`), swapped and lost points (`points`), velocities and what is known of
their errors (`velocity`), and which stretches to keep (`stretch`).
"""
