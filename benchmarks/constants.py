"""Print the list of all numeric constants of the code with their meaning, unit and source, as docs/constants.md.

    python benchmarks/constants.py > docs/constants.md

A constant is a module-level name in capitals whose value has a number. Its meaning is the comment on its line, the
comment above it, or the string below it.
"""

import ast
import io
import tokenize
from collections.abc import Iterator
from pathlib import Path

import mocapclean

ROOT = Path(mocapclean.__file__).parent
HEAD = """# Constants

Every numeric constant of the code with its meaning, unit and source, made by `python benchmarks/constants.py`.
Parameters that users can set are not here: `mocapclean methods NAME` and [configuration.md](configuration.md) have
them. "Chosen by hand" means that no sweep was kept.
"""


def constants() -> Iterator[tuple[str, str, str, str]]:
    """Yield (module, name, value, meaning) of each constant; the meaning is empty where none is stated."""
    for path in sorted(ROOT.rglob("*.py")):
        source = path.read_text(encoding="utf-8")
        comments = {
            token.start[0]: token.string.lstrip("# ")
            for token in tokenize.generate_tokens(io.StringIO(source).readline)
            if token.type == tokenize.COMMENT and not token.string.startswith(("# type:", "# noqa"))
        }
        lines = source.splitlines()
        body = ast.parse(source).body
        for place, node in enumerate(body):
            name = _name(node)
            if name and _has_number(node.value):
                below = body[place + 1] if place + 1 < len(body) else None
                meaning = _meaning(node, below, comments, lines)
                value = " ".join(ast.unparse(node.value).split())
                yield path.relative_to(ROOT).as_posix(), name, value, meaning


def _name(node: ast.stmt) -> str:
    """Return the name of a constant that a statement assigns, or "" if it assigns none."""
    target = (
        node.target if isinstance(node, ast.AnnAssign) else node.targets[0] if isinstance(node, ast.Assign) else None
    )
    name = target.id if isinstance(target, ast.Name) else ""
    if name == "TRAITS":  # the declaration of a method, documented field by field
        return ""
    return name if name.strip("_").isupper() and getattr(node, "value", None) is not None else ""


def _has_number(value: ast.expr) -> bool:
    return any(
        isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool)
        for node in ast.walk(value)
    )


def _meaning(node: ast.stmt, below: ast.stmt | None, comments: dict[int, str], lines: list[str]) -> str:
    """Return the comment on the lines of a statement, the comment block above it, or the string below it."""
    own = " ".join(comments[line] for line in range(node.lineno, node.end_lineno + 1) if line in comments)
    if own:
        return own
    if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant) and isinstance(below.value.value, str):
        return " ".join(below.value.value.split())
    # A comment above stands for all constants up to the next empty line.
    line = node.lineno - 1
    while line >= 1 and lines[line - 1].strip() and line not in comments:
        line -= 1
    block = []
    while line in comments and lines[line - 1].lstrip().startswith("#"):
        block.insert(0, comments[line])
        line -= 1
    return " ".join(block)


def document() -> str:
    """Return the whole document."""
    parts = [HEAD]
    module = ""
    for place, name, value, meaning in constants():
        if place != module:
            parts.append(f"\n## {place}\n\n| constant | value | meaning, unit, source |\n|---|---|---|\n")
            module = place
        short = value if len(value) <= 60 else value[:57] + "..."
        parts.append(f"| `{name}` | `{short}` | {meaning} |\n".replace("‖", "∥").replace(" | | ", " ｜ "))
    return "".join(parts)


if __name__ == "__main__":
    print(document(), end="")
