"""The licence that the pages on measured robots state is looked at before any work."""

from __future__ import annotations

from pathlib import Path

from mjfish.errors import InputError

#: Sentence of the MIT licence that no other has.
_MIT = "Permission is hereby granted, free of charge, to any person obtaining a copy"
#: How many folders above the files are looked into, for repositories have their licence at the top.
_ABOVE = 2


def check_mit(folder: Path) -> None:
    """Refuse files beside, or under, a licence that is not MIT; without any, nothing is said.

    Args:
        folder: of the files; the nearest ``LICENSE`` in it or the two folders above counts.

    Raises:
        InputError: the licence is another one, or cannot be read.
    """
    for place in (folder, *folder.resolve().parents[:_ABOVE]):
        path = place / "LICENSE"
        if path.is_file():
            try:
                text = path.read_text(encoding="utf-8", errors="replace")
            except OSError as error:
                raise InputError(f"{path}: cannot be read: {error.strerror or error}; make it readable") from None
            if _MIT not in " ".join(text.split()):
                raise InputError(
                    f"{path}: not the MIT licence that the files were published under; read it, and whether they may "
                    "still be used so, or give the folder of the published files"
                )
            return
