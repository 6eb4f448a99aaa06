"""Training, its file and its command: the same seed gives the same bytes, damage and mismatch are told."""

import dataclasses
import io
import json
import zipfile

import numpy as np
import pytest
from small_dictionaries import SMALL, learn, twelve_parts

import mocapclean
from mocapclean.dictionaries.dictionary import load
from mocapclean.dictionaries.training import n_steps, train
from mocapclean.errors import FormatError, UsageError
from mocapclean.formats import c3d
from mocapclean.take import Take
from tests.commands import run

RATE = 60.0


def swing(n_frames, phase=0.0):
    t = np.arange(n_frames)[:, None] / RATE
    k = np.arange(12)
    return np.stack(
        [np.sin(4 * t + k / 5 + phase) * 40 + 60 * k, 90 * np.cos(k + t), 100.0 * (k % 4) + 500 * t], axis=2
    )


def take_of(positions, trusted=None, **changes):
    known = np.ones(positions.shape[:2], dtype=bool) if trusted is None else trusted
    names = tuple(f"m{k}" for k in range(12))
    return dataclasses.replace(Take(positions=positions, trusted=known, markers=names, rate=RATE), **changes)


def test_the_same_seed_gives_the_same_dictionary_and_ticks_are_counted():
    ticks = []
    first, second, other = (
        train([take_of(swing(200))], twelve_parts(), SMALL, seed, lambda: ticks.append(1)) for seed in (1, 1, 2)
    )
    assert first.sha256 == second.sha256 != other.sha256
    assert len(ticks) == 3 * n_steps(twelve_parts(), SMALL)
    assert first.atoms["LL"].shape[1] == 5 * 3 * SMALL.window


def test_untrusted_samples_are_not_learnt_from():
    trusted = np.ones((200, 12), dtype=bool)
    trusted[50:60, 4] = trusted[120, 0] = False
    poisoned = [take_of(np.where(trusted[..., None], swing(200), value), trusted) for value in (0.0, np.nan)]
    assert train(poisoned[:1], twelve_parts(), SMALL).sha256 == train(poisoned[1:], twelve_parts(), SMALL).sha256


def test_few_windows_make_few_atoms():
    assert len(learn(swing(31), RATE).atoms["TO"]) == (31 - SMALL.window + 1) // 4


def test_takes_that_do_not_fit_are_refused():
    parts = twelve_parts()
    with pytest.raises(UsageError, match="at least one"):
        train([], parts, SMALL)
    with pytest.raises(UsageError, match="30 Hz after 60 Hz"):
        train([take_of(swing(40)), take_of(swing(40), rate=30.0)], parts, SMALL)
    with pytest.raises(UsageError, match="none named m11"):
        train([take_of(swing(40)).select(np.arange(11))], parts, SMALL)
    with pytest.raises(UsageError, match="12 frames in a row"):
        train([take_of(swing(11))], parts, SMALL)


def test_a_dictionary_is_read_as_it_was_written(tmp_path):
    dictionary = learn(swing(100), RATE)
    for name in ("a.npz", "b.npz"):
        dictionary.save(tmp_path / name)
    again = load(tmp_path / "a.npz")
    assert again.sha256 == dictionary.sha256
    assert again.parts == dictionary.parts
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def rewritten(path, **changes):
    """The file with members replaced (bytes), or left out (None)."""
    with zipfile.ZipFile(path) as old:
        members = {entry.filename: old.read(entry) for entry in old.infolist()}
    members.update({f"{name}.npy": content for name, content in changes.items()})
    with zipfile.ZipFile(path, "w") as new:
        for name, content in members.items():
            if content is not None:
                new.writestr(name, content)


def npy(array):
    file = io.BytesIO()
    np.save(file, array, allow_pickle=True)
    return file.getvalue()


def huge():
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(file, {"descr": "<f8", "fortran_order": False, "shape": (10**12, 3, 3)})
    return file.getvalue()


@pytest.mark.parametrize(
    "changes",
    [
        {"poses": None},
        {"atoms_TO": None},
        {"poses": npy(np.full((3, 12, 3), np.nan))},
        {"poses": npy(np.zeros((3, 11, 3)))},
        {"poses": npy(np.array([{}], dtype=object))},
        {"poses": huge()},
        {"poses": b"not an array"},
        {"atoms_TO": npy(np.zeros((3, 5)))},
        {"header": npy(np.frombuffer(b'{"schema": 99}', dtype=np.uint8))},
        {"header": npy(np.frombuffer(b"[1]", dtype=np.uint8))},
        {"header": npy(np.frombuffer(json.dumps({"schema": 1, "parts": {}}).encode(), dtype=np.uint8))},
    ],
)
def test_a_damaged_dictionary_is_told(tmp_path, changes):
    path = tmp_path / "a.npz"
    learn(swing(60), RATE).save(path)
    rewritten(path, **changes)
    with pytest.raises(FormatError, match=r"a\.npz: is not a dictionary"):
        load(path)


def test_what_is_no_dictionary_is_told(tmp_path):
    with pytest.raises(FormatError, match="cannot be read"):
        load(tmp_path / "none.npz")
    path = tmp_path / "a.npz"
    learn(swing(60), RATE).save(path)
    whole = path.read_bytes()
    for content in (b"", b"PK\x03\x04", whole[: len(whole) // 2], whole[:-1]):
        path.write_bytes(content)
        with pytest.raises(FormatError):
            load(path)


@pytest.fixture
def folder(tmp_path):
    takes = tmp_path / "takes"
    takes.mkdir()
    for name, phase in (("one", 0.0), ("two", 1.0)):
        c3d.create(take_of(swing(120, phase)), takes / f"{name}.c3d")
    trusted = np.ones((120, 12), dtype=bool)
    trusted[40:60, 5] = False
    c3d.create(take_of(np.where(trusted[..., None], swing(120, 0.5), 0.0), trusted), tmp_path / "gap.c3d")
    c3d.create(take_of(swing(120, 0.5)), tmp_path / "truth.c3d")
    lines = ["TO: [m0, m1, m2]", "LL: [m3, m4, m5, m6, m7]", "RL: [m8, m9, m10, m11]"]
    frame = "frame: {origin: [m0], right: [m1], left: [m2], top: [m3], torso: [m0, m1, m2, m3]}"
    (tmp_path / "parts.yaml").write_text("\n".join([*lines, frame]))
    return tmp_path


def test_train_then_fill(folder):
    small = ["--window", 12, "--atoms", 40, "--sweeps", 2]
    made = folder / "swing.dict.npz"
    code, out, _ = run("train", folder / "takes", "-o", made, "--body-parts", folder / "parts.yaml", *small)
    assert code == 0
    assert "2 takes, 240 frames" in out
    for method in ("llc", "srmmp"):
        code, _, err = run(
            "fill", folder / "gap.c3d", "--method", method, "--dictionary", made, "--no-detect", "--overwrite"
        )
        assert (code, err) == (0, "")
        filled, truth = (mocapclean.read(folder / name) for name in ("gap_filled.c3d", "truth.c3d"))
        assert np.sqrt(np.mean((filled.positions - truth.positions)[40:60, 5] ** 2)) < 5.0
    code, _, err = run("train", folder / "takes", "-o", made, "--body-parts", folder / "parts.yaml", *small)
    assert code == 2
    assert "--overwrite" in err


def test_what_cannot_be_done_is_said(folder):
    code, _, err = run("fill", folder / "gap.c3d", "--method", "llc", "--no-detect")
    assert code == 2
    assert "--dictionary" in err
    code, _, err = run(
        "fill", folder / "gap.c3d", "--method", "llc", "--no-detect", "--dictionary", folder / "parts.yaml"
    )
    assert code == 1
    assert "is not a dictionary" in err
    out = folder / "x.npz"
    for arguments, message in (
        ([folder / "takes"], "Got m0, m1"),
        ([folder / "takes", "--body-parts", folder / "none.yaml"], "cannot be read"),
        ([folder / "takes", "--sweeps", 0], "--sweeps"),
        ([folder / "takes", "--unit", "furlong"], "--unit"),
    ):
        code, _, err = run("train", *arguments, "-o", out)
        assert code == 2
        assert message in err
    code, _, err = run("train", folder / "takes", "-o", folder / "x.txt")
    assert (code, ".npz" in err) == (2, True)
    assert not out.exists()
