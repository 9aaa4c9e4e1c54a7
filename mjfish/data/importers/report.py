"""What an importer did to each file: what was kept, what was cut, and how good it is."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Cut:
    """A stretch that was not kept.

    Attributes:
        start: [s] in the file.
        end: [s] in the file.
        reason: why.
    """

    start: float
    end: float
    reason: str

    def __str__(self) -> str:
        return f"{self.start:.2f}-{self.end:.2f} s: {self.reason}"


@dataclass(frozen=True)
class FileReport:
    """One imported file.

    Attributes:
        path: the file.
        trials: names of the trials made of it.
        frames: rows of the file.
        usable: frames in which everything was found.
        kept: samples in the trials.
        beat: frequency of the beat [Hz]; None where there is none or nobody looked.
        speed: mean surge [m/s]; None where no velocity is made of the file.
        noise: sigma of surge, sway [m/s] and yaw rate [rad/s], estimated from this file; None: not known.
        correlation_time: of the errors of the velocities [s]; samples closer than that add hardly any information; 0:
            not known.
        joint_noise: sigma of the joint angles, mean over the joints [rad]; None: not estimated.
        cuts: stretches that were not kept.
        notes: what else was done, sentences.
    """

    path: Path
    trials: tuple[str, ...]
    frames: int
    usable: int
    kept: int
    beat: float | None
    speed: float | None = None
    noise: tuple[float, float, float] | None = None
    correlation_time: float = 0.0
    joint_noise: float | None = None
    cuts: tuple[Cut, ...] = ()
    notes: tuple[str, ...] = ()


#: Headers of `rows`.
HEADERS = (
    "file", "trials", "frames", "usable", "kept", "beat [Hz]", "mean speed [m/s]",
    "sigma surge [m/s]", "sigma sway [m/s]", "sigma yaw_rate [rad/s]", "errors correlated over [s]",
    "sigma joints [rad]", "remarks",
)  # fmt: skip


@dataclass(frozen=True)
class ImportReport:
    """All files of one import.

    Attributes:
        importer: its name.
        files: in the order given.
    """

    importer: str
    files: tuple[FileReport, ...]

    def rows(self) -> list[tuple[str, ...]]:
        """Return one row of text a file, under `HEADERS`, for a table."""
        return [
            (
                file.path.name,
                ", ".join(file.trials),
                str(file.frames),
                str(file.usable),
                str(file.kept),
                "-" if file.beat is None else f"{file.beat:.3f}",
                "-" if file.speed is None else f"{file.speed:.3f}",
                *(
                    f"{sigma:.2g}" if sigma else "-"
                    for sigma in (*(file.noise or (None,) * 3), file.correlation_time, file.joint_noise)
                ),
                "; ".join([*map(str, file.cuts), *file.notes]),
            )
            for file in self.files
        ]
