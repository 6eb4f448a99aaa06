"""Where a page and the files beside it are."""

import hashlib
import os
from pathlib import Path

MOST_EMBEDDED = 12
"""Most takes whose data are in the page itself; those of more takes lie beside it. Chosen by hand: 3 MB each."""
_NAME_DIGITS = 16  # hexadecimal digits of the name of a take's data


def data_folder(page: Path) -> Path:
    """Return the folder beside a page for what does not stand in the page itself."""
    return page.parent / f"{page.stem}_files"


def data_file(page: Path, name: str) -> Path:
    """Return the file of a take's data beside a page, by the take's name in the run."""
    return data_folder(page) / f"take-{hashlib.sha256(os.fsencode(name)).hexdigest()[:_NAME_DIGITS]}.js"


def remove_data(page: Path, files: list[Path]) -> None:
    """Remove the data of takes that stand in the page itself, and the folder if nothing else is in it."""
    for path in files:
        path.unlink(missing_ok=True)
    folder = data_folder(page)
    if folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()
