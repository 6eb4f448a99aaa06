"""The entry point of the command; ``--version`` imports nothing else."""

import gc
import os
import sys
from io import TextIOWrapper

from mocapclean import __version__


def main() -> None:
    """Run the command line."""
    if sys.argv[1:] == ["--version"]:
        print(f"mocapclean {__version__}")
        return
    # The matrices are narrow, so that several BLAS threads only wait for each other. NumPy reads this when imported.
    for library in ("OPENBLAS", "MKL", "OMP"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    for stream in (sys.stdout, sys.stderr):
        # Where Windows writes to a pipe or a file, its encoding has not every letter of a name.
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    from mocapclean.cli import cli

    try:
        cli(prog_name="mocapclean")
    finally:
        # At exit Python would search all objects for cycles to free, as long as it takes to import NumPy once more.
        gc.freeze()


if __name__ == "__main__":
    main()
