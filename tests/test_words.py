"""The code speaks the field's language: private words do not come back as names."""

import ast
import re
from pathlib import Path

import pytest

import mocapclean

ROOT = Path(mocapclean.__file__).parent
MODULES = sorted(ROOT.rglob("*.py"))
PRIVATE = {
    "scene",
    "piece",
    "looks",
    "surer",
    "spare",
    "remains",
    "waits",
    "borne",
    "echoes",
    "toll",
    "wander",
    "backs",
    "rests",
    "narrowed",
    "lesson",
    "surely",
}
"""Words that were names of the project's own making; a textbook term exists for each."""


def names(path: Path) -> set[str]:
    """The parts of all names that a module defines: classes, functions, arguments, variables and attributes."""
    defined = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            defined.add(node.name)
        elif isinstance(node, ast.arg):
            defined.add(node.arg)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            defined.add(node.id)
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            defined.add(node.attr)
    words = {word.lower() for name in defined for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+", name)}
    return words | {name.lower().strip("_") for name in defined}


PUBLIC = {("detection/rules/drift.py", "surely")}
"""Names that users have in their configurations."""


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(ROOT)))
def test_no_private_word_is_a_name(path):
    place = path.relative_to(ROOT).as_posix()
    assert {(place, word) for word in names(path) & PRIVATE} <= PUBLIC


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(ROOT)))
def test_every_module_class_and_public_function_says_first_what_it_is(path):
    """The first sentence of a docstring has at most 35 words."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            text = ast.get_docstring(node) or ""
            first = re.split(r"(?<=[.:;])\s", text.replace("\n", " "))[0]
            assert len(first.split()) <= 35, f"{getattr(node, 'name', path.name)}: {first}"
