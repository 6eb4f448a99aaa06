"""Missing numbers in the spellings of other programs, in BVH and AMC: what is read, what is kept, what is proven."""

import re
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import test_amc
import test_bvh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mocapclean.arrays import Bools, Ints
from mocapclean.errors import FormatError
from mocapclean.formats import amc, bvh
from mocapclean.formats.text import blank, is_missing, is_number, numbers, quick_table
from mocapclean.take import ReadOptions, Take
from mocapclean.take.posed import joint_positions

SPELLED = [
    *("nan", "NaN", "NAN", "nan(ind)", "nan(snan)", "nan(0x8000000000000)", "nan()", "NaNQ", "inf", "Infinity"),
    *("1.#QNAN", "1.#QNAN0", "1.#SNAN", "1.#IND", "1.#IND00", "1.#INF", "1.#INF000000"),
    *("1.#QO", "1.#IO", "1.#R", "1.#J", "1.$"),
]
WORDS = st.builds(
    lambda sign, word, change: (sign + change(word)).encode(),
    st.sampled_from(["", "-", "+"]),
    st.sampled_from(SPELLED),
    st.sampled_from([str, str.lower, str.upper]),
)
OTHERS = [
    b"nano",
    b"infinit",
    b"nan(",
    b"nan)",
    b"nan(a b)",
    b"1.#",
    b"1.#QNANO",
    b"2.#IND",
    b"1#IND",
    b"#IND",
    b"null",
]
CASES = {"bvh": (bvh, test_bvh, 33), "amc": (amc, test_amc, 3)}
"""Module, the module of its tests with a small TEXT, and the line, from 1, before its first frame."""


def number_spans(form: str) -> list[tuple[int, int]]:
    """Return the bytes of all numbers of the small text's frames, in the order of the file."""
    text, first = CASES[form][1].TEXT, CASES[form][2]
    spans, at = [], 0
    for number, line in enumerate(text.splitlines(keepends=True)):
        if number >= first - (form == "bvh"):
            spans += [(at + m.start(), at + m.end()) for m in list(re.finditer(rb"\S+", line))[form == "amc" :]]
        at += len(line)
    return spans


def with_words(text: bytes, spans: list[tuple[int, int]], words: dict[int, bytes]) -> bytes:
    """Return the text with words in the place of some numbers."""
    for index in sorted(words, reverse=True):
        first, stop = spans[index]
        text = text[:first] + words[index] + text[stop:]
    return text


def read(form: str, path: Path) -> Take:
    return CASES[form][0].read(path, ReadOptions())


@settings(max_examples=300, deadline=None, suppress_health_check=list(HealthCheck), database=None)
@given(st.sampled_from(sorted(CASES)), st.data())
def test_words_are_missing_and_a_repair_respells_its_own_alone(tmp_path: Path, form: str, data: st.DataObject) -> None:
    module, tests, _ = CASES[form]
    spans = number_spans(form)
    words = data.draw(st.dictionaries(st.integers(0, len(spans) - 1), WORDS, min_size=1, max_size=12))
    repaired = data.draw(st.sets(st.sampled_from(sorted(words)), min_size=1))
    truth = read(form, tests.save(tmp_path, tests.TEXT))
    text = with_words(tests.TEXT, spans, words)
    take = read(form, tests.save(tmp_path, text))
    # 1. Exactly these numbers are missing; all others are as they were.
    order, n_channels = np.argsort(truth.origin.document.places, axis=1), truth.poses.shape[1]
    missing = marked(words, order)
    np.testing.assert_array_equal(np.isnan(take.poses), missing)
    np.testing.assert_array_equal(take.poses[~missing], truth.poses[~missing])
    # 2. A repair respells its own words; every other byte stays. Each repaired frame has a known joint in the end.
    document = take.origin.document
    wanted = marked(repaired, order)
    partly = np.where(wanted, document.spelled(truth.poses), take.poses)
    known = np.isfinite(joint_positions(document.skeleton, partly)).all(axis=2)
    repaired |= {index for index in words if not known[index // n_channels].any()}
    wanted = marked(repaired, order)
    poses = np.where(wanted, document.spelled(truth.poses), take.poses)
    positions = joint_positions(document.skeleton, poses)
    filled = wanted.any(axis=1)[:, None] & np.isfinite(positions).all(axis=2)
    out = tmp_path / f"out.{form}"
    written = module.write(replace(take, poses=poses, positions=positions, filled=filled), out)
    module.prove(written, out)
    left = {index: word for index, word in words.items() if index not in repaired}
    shape = with_words(tests.TEXT, spans, left | dict.fromkeys(repaired, b"@"))
    pattern = re.escape(shape).replace(re.escape(b"@"), rb"[-.\d]+")
    assert re.fullmatch(pattern, out.read_bytes())
    np.testing.assert_array_equal(np.isnan(read_out(form, out, tests).poses), missing & ~wanted)
    # 3. The proof sees a word that was spelled anew in a frame without a repair.
    for index in [index for index in left if not wanted[index // n_channels].any()][:1]:
        out.write_bytes(with_words(tests.TEXT, spans, left | {index: b"0.5"} | dict.fromkeys(repaired, b"0.25")))
        with pytest.raises(FormatError):
            module.prove(written, out)


def marked(indices: Iterable[int], order: Ints) -> Bools:
    """Return the channels (F, C) of some numbers; order: (F, C) channels in the order of the file."""
    mask = np.zeros(order.shape, dtype=bool)
    for index in indices:
        frame, place = divmod(index, order.shape[1])
        mask[frame, order[frame, place]] = True
    return mask


def read_out(form: str, out: Path, tests: ModuleType) -> Take:
    """Return the take of a written text, read under the name that its skeleton belongs to."""
    return read(form, tests.save(out.parent, out.read_bytes()))


@settings(max_examples=300, deadline=None, database=None)
@given(st.lists(st.lists(WORDS | st.just(b"1.5"), min_size=3, max_size=3), min_size=1, max_size=5))
def test_quick_and_slow_reading_agree(rows: list[list[bytes]]) -> None:
    slow = numbers(Path("take.bvh"), rows, range(len(rows)))
    quick = quick_table([b" ".join(row) for row in rows])
    assert quick is not None
    np.testing.assert_array_equal(quick.reshape(-1), slow)
    np.testing.assert_array_equal(np.isnan(slow), [is_missing(token) for row in rows for token in row])


@pytest.mark.parametrize("token", OTHERS)
def test_other_words_are_refused(tmp_path: Path, token: bytes) -> None:
    assert not is_number(token)
    # AMC ignores brackets and what follows #, so that a number may be left there.
    for form in sorted(CASES) if token.isalpha() else ["bvh"]:
        tests, spans = CASES[form][1], number_spans(form)
        with pytest.raises(FormatError, match="Got"):
            read(form, tests.save(tmp_path, with_words(tests.TEXT, spans, {len(spans) - 1: token})))


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        (b"a -nan(ind) b # c -nan(ind)", b"a -nan(ind) b              "),
        (b"a 1.#QNAN,-1.#IND#1.#INF\nb", b"a 1.#QNAN -1.#IND       \nb"),
        (b"# (1.#IND) nan(ind)\n1 1.#j\n", b"                   \n1 1.#j\n"),
        (b"(nan(ind) 1.)#x", b" nan(ind) 1.   "),
        (b"1.#comment", b"1.        "),
        (b"1.#INFO", b"1.     "),
        (b"ban(ind) n(1)", b"ban ind  n 1 "),
    ],
)
def test_comments_and_brackets_spare_missing_numbers(text: bytes, wanted: bytes) -> None:
    assert blank(text) == wanted
