"""What was journaled is there again, whatever ended the run that wrote it."""

import json
import subprocess
import sys

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mocapclean.batch.journal import EarlierOutput, Journal, earlier_outputs
from mocapclean.errors import UsageError


def take(number, output="f" * 64):
    return {"source": f"{number}.c3d", "status": "repaired", "sha256": {"source": "", "output": output}}


def test_rows_come_back_and_the_last_good_one_counts(tmp_path):
    with Journal(tmp_path) as journal:
        for name in ("a.c3d", "b.c3d", "é\udcff\n.c3d"):
            journal.begin(name)
        journal.add("a.c3d", "key 1", take(1))
        journal.add("é\udcff\n.c3d", "key 2", take(2))
        journal.add("b.c3d", "", take(3))
        assert journal.row("b.c3d") == take(3)
        assert journal.row("c.c3d") is None
    with Journal(tmp_path) as journal:
        journal.add("a.c3d", "key 4", take(4, "e" * 64))
        journal.add("é\udcff\n.c3d", "", take(5))
    known = earlier_outputs(tmp_path)
    assert [known[name].key for name in ("a.c3d", "b.c3d", "é\udcff\n.c3d")] == ["key 4", "", "key 2"]
    assert known["a.c3d"].sha256 == "e" * 64
    assert known["b.c3d"] == EarlierOutput()
    with Journal(tmp_path) as journal:
        journal.adopt("é\udcff\n.c3d", known["é\udcff\n.c3d"])
        assert journal.row("é\udcff\n.c3d") == take(2)


def test_every_shard_has_its_own_and_all_are_read(tmp_path):
    with Journal(tmp_path, "journal-1-of-2") as one, Journal(tmp_path, "journal-2-of-2") as two:
        one.add("a.c3d", "1", take(1))
        two.add("b.c3d", "2", take(2))
    known = earlier_outputs(tmp_path)
    assert set(known) == {"a.c3d", "b.c3d"}
    with Journal(tmp_path) as journal:
        journal.adopt("b.c3d", known["b.c3d"])
        assert journal.row("b.c3d") == take(2)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 400), st.binary(max_size=40))
def test_a_torn_journal_keeps_its_whole_lines_and_can_be_gone_on_with(tmp_path_factory, kept, rest):
    folder = tmp_path_factory.mktemp("torn")
    with Journal(folder) as journal:
        for number in range(3):
            journal.add(f"{number}.c3d", "key", take(number))
    whole = journal.path.read_bytes()
    torn = whole[:kept] + rest.replace(b"\n", b"\0")
    journal.path.write_bytes(torn)
    n_whole = whole[:kept].count(b"\n")
    assert set(earlier_outputs(folder)) == {f"{number}.c3d" for number in range(n_whole)}
    with Journal(folder) as journal:
        journal.add("new.c3d", "key", take(9))
        assert journal.row("new.c3d") == take(9)
    assert set(earlier_outputs(folder)) == {*(f"{number}.c3d" for number in range(n_whole)), "new.c3d"}
    assert journal.path.read_bytes().startswith(whole[:kept].rpartition(b"\n")[0])


def test_lines_that_are_no_journal_are_passed_over(tmp_path):
    with Journal(tmp_path) as journal:
        journal.add("a.c3d", "key", take(1))
    with journal.path.open("ab") as file:
        file.write(b"\0\0\0\n[1]\n{}\nhello\n")
    with Journal(tmp_path) as journal:
        journal.add("b.c3d", "key", take(2))
    assert set(earlier_outputs(tmp_path)) == {"a.c3d", "b.c3d"}


def test_two_runs_cannot_write_into_one_folder(tmp_path):
    other = (
        "import sys; from pathlib import Path; from mocapclean.batch.journal import Journal\n"
        "try:\n    Journal(Path(sys.argv[1]))\nexcept Exception as fault: print(fault)"
    )
    with Journal(tmp_path):
        said = subprocess.run([sys.executable, "-c", other, tmp_path], capture_output=True, text=True, check=True)
        assert "another run is writing there" in said.stdout
    said = subprocess.run([sys.executable, "-c", other, tmp_path], capture_output=True, text=True, check=True)
    assert said.stdout == ""


def test_a_folder_that_is_none_is_told(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(UsageError, match="cannot be written"):
        Journal(tmp_path / "file")


def test_on_a_full_disk_the_rows_stay_and_the_journal_stays_whole(tmp_path):
    code = """
import json, resource, signal, sys
from pathlib import Path
from mocapclean.batch.journal import Journal
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
with Journal(Path(sys.argv[1])) as journal:
    journal.add("a.c3d", "key", {"n": 1, "sha256": {"output": ""}})
    resource.setrlimit(resource.RLIMIT_FSIZE, (200, 200))
    journal.add("b.c3d", "key", {"n": "x" * 300, "sha256": {"output": ""}})
    journal.add("c.c3d", "key", {"n": 3, "sha256": {"output": ""}})
    rows = [journal.row(f"{name}.c3d")["n"] for name in "abc"]
    print(json.dumps([journal.fault, *rows]))
"""
    said = subprocess.run([sys.executable, "-c", code, tmp_path], capture_output=True, text=True, check=True)
    fault, *numbers = json.loads(said.stdout)
    assert "File too large" in fault
    assert numbers == [1, "x" * 300, 3]
    assert set(earlier_outputs(tmp_path)) == {"a.c3d", "c.c3d"}
