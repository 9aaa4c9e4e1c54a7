"""Makes the dataset that ships with the package (mjfish/demo); it holds what `mjfish demo` is to find out.

Run it from the repository: python tools/make_demo.py
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from mjfish.arrays import readonly
from mjfish.data import save
from mjfish.effects import find
from mjfish.fish import load_fish
from mjfish.simulation.synthetic import generate

FOLDER = Path(__file__).parents[1] / "mjfish" / "demo"
TRUTH = {
    "c_m.head": 0.62,
    "c_m.body": 0.35,
    "c_m.tail": 0.48,
    "c_d.head": 1.9,
    "c_d.body": 1.2,
    "c_d.tail": 1.6,
    "c_f.head": 0.011,
    "c_f.body": 0.009,
    "c_f.tail": 0.014,
    "tail_compliance.compliance": 0.09,
    "tail_compliance.damping": 0.03,
}


def main() -> None:
    """Make the demo."""
    dataset = generate(
        load_fish("pike"),
        ["v1", "v5", "v1-v5", "v3-t1", "v7", "v1-t2"],
        values=TRUTH,
        effects=[find("tail_compliance")],
        noise=np.array([0.01, 0.01, 0.05]),
        seed=20261121,
        held_out=["v7", "v1-t2"],
        name="demo: a pool session with a robotic pike",
    )
    rounded = [replace(trial, velocity=readonly(np.round(trial.velocity, 5))) for trial in dataset.trials]
    save(replace(dataset, trials=tuple(rounded)), FOLDER)


if __name__ == "__main__":
    main()
