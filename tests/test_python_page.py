"""The page about Python: its code is the script beside it, which runs, and its table is that of the Dataset."""

import logging
import re
from pathlib import Path

import pytest

import mocapclean
from mocapclean.take import Take

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
SCRIPT = ROOT / "docs" / "examples" / "from_python.py"


def test_the_code_of_the_page_is_the_script():
    blocks = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    imports = [line for block in blocks for line in block.splitlines() if line.startswith("import ")]
    script = SCRIPT.read_text(encoding="utf-8")
    assert {line for line in script.splitlines() if line.startswith("import ")} == {*imports}
    code = "".join(re.sub(r"^import .*\n+", "", block, flags=re.MULTILINE) for block in blocks)
    own = script.split("import mocapclean\n", 1)[1]
    assert [line for line in own.splitlines() if line] == [line for line in code.splitlines() if line]


def test_the_script_runs(tmp_path, monkeypatch, capsys):
    pytest.importorskip("xarray", reason="the extra xarray is not installed")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(logging, "basicConfig", lambda **options: None)
    (tmp_path / "sample_data").symlink_to(ROOT / "sample_data")
    names: dict = {}
    exec(compile(SCRIPT.read_text(encoding="utf-8"), str(SCRIPT), "exec"), names)
    printed = capsys.readouterr().out
    assert re.search(r"print\(take\)  # (.*)", PAGE)[1] in printed
    assert re.search(r"print\(result\)  # (.*?)\.\.\.", PAGE)[1] in printed
    assert isinstance(names["again"], Take)
    written = mocapclean.read(tmp_path / "walk_clean.c3d")
    assert written.trusted.all()


def test_the_package_says_that_it_is_typed():
    assert (Path(mocapclean.__file__).parent / "py.typed").exists()
    assert '"docs/examples"' in (ROOT / "pyproject.toml").read_text(encoding="utf-8")


def test_the_table_of_variables_is_that_of_the_dataset():
    pytest.importorskip("xarray", reason="the extra xarray is not installed")
    dataset = mocapclean.read(ROOT / "sample_data" / "walk.c3d").to_xarray()
    rows = re.findall(r"^\| `(\w+)` \| (all four|without space)", PAGE, re.MULTILINE)
    assert [
        (name, "all four" if "space" in dataset[name].dims else "without space") for name in dataset.data_vars
    ] == rows


@pytest.mark.parametrize(
    "option", ["method", "max_gap", "max_error", "fill_poor", "keep_contacts", "self_check", "markers"]
)
def test_the_options_of_fill_are_on_the_page(option):
    import inspect

    assert option in inspect.signature(mocapclean.fill).parameters
    assert f"`{option}`" in PAGE
