"""Write the gallery: ``python -m studies.gallery --out out/gallery``."""

import argparse
from pathlib import Path

from studies.gallery.pages import write

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--out", type=Path, default=Path("out/gallery"), help="folder of the pages")
for page in write(parser.parse_args().out):
    print(page)
