"""Which takes a command gets, however they are named."""

import io
import os
import subprocess
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mocapclean.batch import inputs
from mocapclean.batch.inputs import Input
from mocapclean.errors import UsageError

TREE = ("b.c3d", "a.C3D", "sub/x.bvh", "sub/deep/y.amc", "other/x.bvh")
NO_TAKES = ("05.asf", "notes.txt", ".hidden.c3d", "._a.C3D", ".snapshot/a.c3d", "sub/.take.abc.part.c3d", "c3d")

paths = st.lists(st.text("abc. é\n*/", min_size=1, max_size=8), max_size=30, unique=True).map(
    lambda names: [Input(path=Path("x"), relative=Path(name)) for name in names]
)


@pytest.fixture
def tree(tmp_path):
    for name in (*TREE, *NO_TAKES):
        (tmp_path / "captures" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "captures" / name).touch()
    return tmp_path / "captures"


def relatives(found):
    return [each.relative.as_posix() for each in found]


def test_a_folder_is_every_take_in_it_in_a_fixed_order(tree):
    found = list(inputs.find([tree]))
    assert relatives(found) == ["a.C3D", "b.c3d", "other/x.bvh", "sub/x.bvh", "sub/deep/y.amc"]
    assert all(each.path == tree / each.relative for each in found)


def test_a_named_file_keeps_its_name_alone_unless_a_root_is_given(tree):
    files = [tree / "sub" / "x.bvh", tree / "notes.txt"]
    assert relatives(inputs.find(files)) == ["x.bvh", "notes.txt"]
    assert relatives(inputs.find(files, tree)) == ["sub/x.bvh", "notes.txt"]
    assert relatives(inputs.find([tree / "sub"], tree)) == ["sub/x.bvh", "sub/deep/y.amc"]


def test_what_is_not_below_the_root_is_refused(tree):
    for path in (tree / ".." / "elsewhere.c3d", tree / "sub" / ".." / ".." / "x.c3d", Path("/etc/x.c3d")):
        with pytest.raises(UsageError, match="must lie below"):
            list(inputs.find([path], tree))


def test_the_output_folder_is_no_input(tree):
    assert relatives(inputs.find([tree], skip=tree / "sub")) == ["a.C3D", "b.c3d", "other/x.bvh"]
    assert len(list(inputs.find([tree], skip=tree / "none"))) == len(TREE)


def test_links_are_followed_and_loops_are_not(tree, tmp_path):
    (tmp_path / "store").mkdir()
    (tmp_path / "store" / "z.c3d").touch()
    (tree / "linked").symlink_to(tmp_path / "store")
    (tree / "sub" / "deep" / "up").symlink_to(tree)
    (tree / "self").symlink_to("self")
    (tree / "self.c3d").symlink_to("self.c3d")
    (tree / "lost.c3d").symlink_to("nowhere.c3d")
    found = relatives(inputs.find([tree]))
    assert "linked/z.c3d" in found
    assert {"self.c3d", "lost.c3d"} <= set(found)
    assert len(found) == len(set(found)) == len(TREE) + 3


def test_folders_may_be_deeper_than_python_recurses(tmp_path):
    folder, relative = os.open(tmp_path, os.O_RDONLY), Path()
    for _ in range(1200):
        os.mkdir("d", dir_fd=folder)
        inner = os.open("d", os.O_RDONLY, dir_fd=folder)
        os.close(folder)
        folder, relative = inner, relative / "d"
    os.close(os.open("x.c3d", os.O_CREAT | os.O_WRONLY, dir_fd=folder))
    os.close(folder)
    assert [each.relative for each in inputs.find([tmp_path])] == [relative / "x.c3d"]
    subprocess.run(["rm", "-rf", tmp_path / "d"], check=True)


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser can read everywhere")
def test_a_folder_that_cannot_be_read_is_refused(tree):
    (tree / "sub").chmod(0)
    try:
        with pytest.raises(UsageError, match="cannot be read: Permission denied"):
            list(inputs.find([tree]))
    finally:
        (tree / "sub").chmod(0o755)


@given(st.lists(st.binary(min_size=1, max_size=20).filter(lambda name: b"\0" not in name), max_size=10))
def test_names_ended_by_nul_may_hold_anything(names):
    found = inputs.read_list(io.BytesIO(b"".join(name + b"\0" for name in names)), null=True)
    assert [os.fsencode(path) for path in found] == [os.fsencode(Path(os.fsdecode(name))) for name in names]


def test_lists_in_lines_may_come_from_any_system():
    assert inputs.read_list(io.BytesIO(b"a b.c3d\r\n\n sub/x.bvh\ny.amc")) == [
        Path("a b.c3d"),
        Path(" sub/x.bvh"),
        Path("y.amc"),
    ]


def test_a_list_of_the_other_kind_is_refused():
    with pytest.raises(UsageError, match="add -0"):
        inputs.read_list(io.BytesIO(b"a.c3d\0b.c3d\0"))


def test_patterns_are_of_the_name_or_with_a_slash_of_the_path(tree):
    found = list(inputs.find([tree]))
    assert relatives(inputs.matching(found, ["*.bvh"], [])) == ["other/x.bvh", "sub/x.bvh"]
    assert relatives(inputs.matching(found, ["sub/*"], ["*/deep/*"])) == ["sub/x.bvh"]
    assert relatives(inputs.matching(found, [], ["x.*", "[ab].*"])) == ["sub/deep/y.amc"]


@given(paths, st.integers(1, 7), st.data())
def test_shards_are_disjoint_complete_and_do_not_depend_on_the_others(found, count, data):
    parts = [inputs.shard(found, index + 1, count) for index in range(count)]
    assert sorted(name for part in parts for name in relatives(part)) == sorted(relatives(found))
    some = data.draw(st.lists(st.sampled_from(found), unique_by=id)) if found else []
    for index, part in enumerate(parts):
        assert {each.relative for each in inputs.shard(some, index + 1, count)} <= {each.relative for each in part}


def test_shards_are_of_about_one_size():
    found = [Input(path=Path("x"), relative=Path(f"take_{number:04}.c3d")) for number in range(2000)]
    sizes = [len(inputs.shard(found, index + 1, 20)) for index in range(20)]
    assert 60 < min(sizes) <= max(sizes) < 140
