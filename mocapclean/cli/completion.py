"""``mocapclean completion``: the script by which a shell completes commands, options and values."""

from typing import Any

import click

from mocapclean.cli.guard import guarded
from mocapclean.cli.options import Command, examples


@click.command(
    "completion",
    cls=Command,
    epilog=examples(
        'eval "$(mocapclean completion bash)"    # in ~/.bashrc',
        'eval "$(mocapclean completion zsh)"     # in ~/.zshrc',
        "mocapclean completion fish > ~/.config/fish/completions/mocapclean.fish",
    ),
)
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
@guarded
def command(**options: Any) -> int:
    """Print the completion script of a SHELL: for commands, options, methods, keys, and the markers of a take."""
    from mocapclean.cli.actions import completion

    return completion.work(**options)
