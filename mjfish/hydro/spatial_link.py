"""The record of one link that moves in space: what `mjfish.hydro.spatial_force` reads, as numbers only."""

from __future__ import annotations

import numpy as np

from mjfish.hydro.outline import INTERVALS, STRIPS

#: One link in three dimensions; every field is a float64, so that a record is also a plain row of numbers.
#: body: id of its body; carrier: where that body stands in the list of bodies that the water reaches.
#: origin (3,): of the strips' frame in the body's frame [m]; turn (9,): its axes, row by row: x along the strips, y, z.
#: center (3,): centre of buoyancy in the body's frame [m]; volume: displaced [m3].
#: length ... roll_damping: of the water on the link, see `mjfish.mujoco.strip_link.StripLink`.
#: the rest: integrals, see `mjfish.hydro.outline.LinkOutline`.
SPATIAL = np.dtype(
    [
        ("body", "f8"),
        ("carrier", "f8"),
        ("origin", "f8", (3,)),
        ("turn", "f8", (9,)),
        ("center", "f8", (3,)),
        ("volume", "f8"),
        ("length", "f8"),
        ("density", "f8"),
        ("c_m", "f8"),
        ("c_d", "f8"),
        ("c_f", "f8"),
        ("munk", "f8"),
        ("roll_damping", "f8"),
        ("added", "f8", (3,)),
        ("added_width", "f8", (3,)),
        ("added_roll", "f8"),
        ("roll_drag", "f8"),
        ("wetted", "f8"),
        ("node_height", "f8", (INTERVALS + 1,)),
        ("height_moment", "f8", (INTERVALS + 1, 4)),
        ("node_width", "f8", (INTERVALS + 1,)),
        ("width_moment", "f8", (INTERVALS + 1, 4)),
        ("strip_r", "f8", (STRIPS,)),
        ("strip_weight", "f8", (STRIPS,)),
        ("strip_height", "f8", (STRIPS,)),
        ("strip_width", "f8", (STRIPS,)),
    ],
    align=True,
)
