"""A coverage-guided fuzzer of one reader, by atheris: ``python fuzz.py READER FOLDER [options of libFuzzer]``.

Inputs grow from the valid file, by libFuzzer's mutations and by ours. What fails stays in the folder as ``crash-...``.
"""

from __future__ import annotations

import sys
import warnings
from pathlib import Path
from random import Random

import atheris

#: What is watched for new branches. Modules with compiled functions cannot be: numba would compile the watching.
WATCHED = ("data", "files", "fish", "comparison", "model", "design")
ROOT = Path(__file__).parents[2] / "mjfish"
_PARTS = (path.relative_to(ROOT).with_suffix("").parts for path in ROOT.rglob("*.py"))
_OTHERS = [".".join(("mjfish", *parts)).removesuffix(".__init__") for parts in _PARTS if parts[0] not in WATCHED]

with atheris.instrument_imports(include=["mjfish", "mcap", "mcap_ros2"], exclude=_OTHERS):
    from readers import readers


def main(name: str, folder: Path, options: list[str]) -> None:
    """Fuzz a reader in a folder."""
    made, inputs = folder / "made", folder / "inputs"
    made.mkdir(parents=True)
    inputs.mkdir()
    reader = readers(made)[name]
    reader.prepare(made)
    (inputs / "valid").write_bytes(reader.valid)

    def mutate(raw: bytes, most: int, seed: int) -> bytes:
        random = Random(seed)  # noqa: S311
        if random.random() < 0.5:
            return atheris.Mutate(raw, most)
        try:
            return random.choice(reader.mutations)(raw, random)[:most]
        except Exception:  # a mutation that needs a table, or a tree, and there is none left
            return raw

    def read(raw: bytes) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            reader.outcome(raw, made)

    arguments = [sys.argv[0], f"-max_len={2 * len(reader.valid)}", f"-artifact_prefix={folder}/", *options, str(inputs)]
    atheris.Setup(arguments, read, custom_mutator=mutate)
    atheris.Fuzz()


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), sys.argv[3:])
