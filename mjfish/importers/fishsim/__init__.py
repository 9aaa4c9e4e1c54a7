"""Importer of the marker files of srl-ethz/fishsim: steady swimming of a six-link tendon-driven fish robot.

Pixels become metres (`markers`), lost markers are found (`tracking`) and usable stretches chosen (`stretch`); the head
gives the pose (`head`), the tail the joint angles (`tail`), local polynomials the velocities and their noise
(`motion`).
"""

from mjfish.importers.fishsim.run import import_files

__all__ = ["import_files"]
