"""The rooms import in one direction only."""

import ast
from pathlib import Path

import pytest

import mocapclean

ROOT = Path(mocapclean.__file__).parent
ORDER = (
    "__main__",
    "cli",
    "batch",
    "report",
    "experiments",
    "pipeline",
    "config",
    "detection",
    "simulate",
    "formats",
    "solvers",
    "dictionaries",
    "evaluation",
    "take",
    "geometry",
    "numerics",
    "arrays",
    "files",
    "cores",
    "progress",
    "logs",
    "json_values",
    "parameters",
    "registry",
    "units",
    "errors",
)
PEERS = {("detection", "simulate"), ("simulate", "formats"), ("formats", "solvers"), ("detection", "formats")}


def room_of(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return parts[0]


def imported(path: Path) -> set[str]:
    """The rooms that a module imports anywhere, lazily or not."""
    rooms = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = (
                [f"{node.module}.{alias.name}" for alias in node.names]
                if node.module == "mocapclean"
                else [node.module]
            )
        for name in names:
            parts = name.split(".")
            if parts[0] == "mocapclean" and len(parts) > 1 and parts[1] != "__version__":
                rooms.add(parts[1])
    return rooms


MODULES = sorted(path for path in ROOT.rglob("*.py") if path != ROOT / "__init__.py")


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_run_down_the_list(path):
    room = room_of(path)
    for other in imported(path) - {room}:
        assert ORDER.index(other) > ORDER.index(room), f"{room} must not import {other}"
        assert (room, other) not in PEERS, f"{room} must not know {other}"


def test_every_room_is_in_the_list():
    assert {room_of(path) for path in MODULES} == set(ORDER)
