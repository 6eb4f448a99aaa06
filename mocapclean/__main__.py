"""The command's entry point; asking for the version loads nothing else."""

import os
import sys

from mocapclean import __version__


def main() -> None:
    """Run the command line."""
    if sys.argv[1:] == ["--version"]:
        print(f"mocapclean {__version__}")
        return
    # On matrices this narrow more BLAS threads only wait for each other; it must be said before NumPy is loaded.
    for library in ("OPENBLAS", "MKL", "OMP"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    from mocapclean.cli import cli

    cli(prog_name="mocapclean")


if __name__ == "__main__":
    main()
