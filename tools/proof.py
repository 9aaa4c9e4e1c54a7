"""What is claimed of the water in MuJoCo, measured anew: rewrites the numbers of docs/theory.md.

    python tools/proof.py [--print]

A claim is one function of `proofs` that returns numbers, and a row of a table in `proofs.tables`.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from rich.console import Console
from rich.progress import Progress

from mjfish.files.writing import write_text
from proofs.tables import TABLES

PAGE = Path(__file__).parents[1] / "docs" / "theory.md"
BEGIN, END = "<!-- numbers: begin (python tools/proof.py) -->", "<!-- numbers: end -->"


def section(page: str) -> str:
    """Return what stands between the markers of a page.

    Raises:
        SystemExit: the page has not both, once.
    """
    if page.count(BEGIN) != 1 or page.count(END) != 1 or page.index(BEGIN) > page.index(END):
        raise SystemExit(f"{PAGE}: expected the lines '{BEGIN}' and '{END}', once each and in this order")
    return page.partition(BEGIN)[2].partition(END)[0].strip()


def measured() -> str:
    """Measure every table."""
    tables = []
    with Progress(console=Console(stderr=True), transient=True) as progress:
        for make in progress.track(TABLES, description="proof"):
            tables.append(make().markdown())
    return "\n\n".join(tables)


def main() -> int:
    """Measure, and rewrite the page or print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--print", action="store_true", help="print the tables instead")
    only_print = parser.parse_args().print
    page = PAGE.read_text(encoding="utf-8")
    section(page)
    told = measured()
    if only_print:
        print(told)
        return 0
    before, after = page.partition(BEGIN)[0], page.partition(END)[2]
    write_text(PAGE, f"{before}{BEGIN}\n\n{told}\n\n{END}{after}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
