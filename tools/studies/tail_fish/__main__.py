"""Diagnose the public runs of a one-joint fish and write the page on them.

python -m studies.tail_fish [--out out/tail-fish] [--page docs/tail-fish.md]
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from mjfish.diagnosis import diagnose
from mjfish.errors import MjfishError
from mjfish.files.writing import check_folder, make_folder, write_text
from studies import console
from studies.tail_fish.page import page
from studies.tail_fish.runs import divided, files, settings, told


def main() -> None:
    """Diagnose the runs where the folder has no answer yet, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("out/tail-fish"), help="folder of the answer")
    parser.add_argument("--page", type=Path, help="page to write")
    options = parser.parse_args()
    try:
        check_folder(options.out)
        study, recorded = settings(), files()
        make_folder(options.out)
        answer = options.out / "answer.json"
        if not answer.is_file():
            with console.progress_bar() as bar:
                found = told(diagnose(divided(recorded, study), progress=bar))
            write_text(answer, json.dumps(found, indent=1, allow_nan=False) + "\n")
        text = page(json.loads(answer.read_text(encoding="utf-8")), study)
        if options.page is not None:
            write_text(options.page, text)
        console.out.print(text)
    except MjfishError as error:
        raise SystemExit(f"error: {error}") from None


if __name__ == "__main__":
    main()
