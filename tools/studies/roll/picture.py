"""Draw the picture of docs/roll.md: the free fish seen from behind at a few instants of the fast start.

MUJOCO_GL=egl python -m studies.roll.picture --out docs/images/roll.png
"""

from __future__ import annotations

import argparse
import struct
import zlib
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mjfish.mujoco import SimRollout
from studies.roll.runs import mode

_MODEL = Path(__file__).parents[3] / "models" / "xml" / "pike_free.xml"
#: Instants [s], and size of each panel [px].
INSTANTS = (0.1, 0.24, 0.4, 0.7, 1.15)
WIDTH, HEIGHT = 320, 300
#: Of the camera: distance to the fish [m], and how far it looks down [deg].
DISTANCE, ELEVATION = 0.75, -24.0

Image = NDArray[np.uint8]


def picture(run: SimRollout) -> Image:
    """Return the panels side by side, (HEIGHT, n WIDTH, 3)."""
    model = mujoco.MjModel.from_xml_path(str(_MODEL))
    data = mujoco.MjData(model)
    camera = mujoco.MjvCamera()
    camera.distance, camera.elevation = DISTANCE, ELEVATION
    panels = []
    with mujoco.Renderer(model, HEIGHT, WIDTH) as renderer:
        for instant in INSTANTS:
            k = int(np.searchsorted(run.time, instant))
            roll, pitch, heave = run.attitude[k]
            x, y, yaw = run.pose[k]
            data.qpos[:3] = x, y, heave
            data.qpos[3:7] = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_quat(scalar_first=True)
            data.qpos[7:] = run.joint_angle[k]
            mujoco.mj_forward(model, data)
            camera.lookat[:] = data.subtree_com[1]
            camera.azimuth = np.degrees(yaw)
            renderer.update_scene(data, camera)
            panels.append(renderer.render())
    return np.concatenate(panels, axis=1)


def png(image: Image) -> bytes:
    """Return a picture (rows, columns, 3) as a PNG file."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    rows, columns, _ = image.shape
    lines = b"".join(b"\x00" + row.tobytes() for row in image)
    head = struct.pack(">IIBBBBB", columns, rows, 8, 2, 0, 0, 0)
    body = chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(lines, 9)) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + body


def main() -> None:
    """Run the fast start and draw it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("docs/images/roll.png"), help="file to write")
    out = parser.parse_args().out
    partial = out.with_suffix(".partial")
    partial.write_bytes(png(picture(mode("fast").free)))
    partial.replace(out)


if __name__ == "__main__":
    main()
