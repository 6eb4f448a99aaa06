"""The command's entry point; asking for the version loads nothing else."""

import sys

from mocapclean import __version__


def main() -> None:
    """Run the command line."""
    if sys.argv[1:] == ["--version"]:
        print(f"mocapclean {__version__}")
        return
    from mocapclean.cli import cli

    cli(prog_name="mocapclean")


if __name__ == "__main__":
    main()
