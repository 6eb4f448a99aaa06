"""Takes are sorted by how much they need a person, with reasons in words."""

import pytest

from mocapclean.report.attention import FIRST, NONE, SECOND, attention
from mocapclean.report.page.words import methods_paragraph

COUNTS = {"samples": 1000, "untrusted": 10, "missing": 10, "filled": 10, "replaced": 0, "left": 0, "moved": 0}
GAP = {
    "marker": "LANK",
    "first": 5,
    "last": 14,
    "length": 10,
    "rules": ["missing"],
    "samples_filled": 10,
    "grade": "good",
}
GAP |= {"samples_replaced": 0, "largest_move": None, "left_because": "", "expected_3d": 1.0, "status": "filled"}
FINDING = {"rule": "swap", "level": "warning", "marker": "LTOE", "first": 3, "last": 9, "message": "exchanged."}
FINDING |= {"suspicion": True, "advice": ""}


def row(*findings, gap=None, **counts):
    return {
        "source": "a/take.c3d",
        "status": "repaired",
        "error": "",
        "method": "kriging",
        "markers": 10,
        "frames": 100,
        "rate": 100.0,
        "largest_move": (gap or GAP)["largest_move"],
        "counts": {**COUNTS, "suspicious": 0, "invalidated": 0, **counts},
        "gaps": [gap or GAP],
        "findings": list(findings),
        "self_check": None,
        "accuracy": {"filled": None},
        "bones": {"from": "rigid pairs", "lengths": [], "skeleton_rmse": {"before": 1.0, "after": 1.0}},
    }


LEFT = row(gap={**GAP, "samples_filled": 0, "left_because": "the expected error is graded poor"}, filled=0, left=10)
REPLACED = row(gap={**GAP, "samples_replaced": 3, "largest_move": 44.0}, replaced=3)
FAIR = row(gap={**GAP, "grade": "fair", "expected_3d": 21.0})
SUSPICIOUS = row(FINDING, suspicious=7)
FAILED = {"source": "a/take.c3d", "status": "failed", "error": "a/take.c3d, byte 2: no points."}
BENT = row()
BENT["bones"] = {"lengths": [], "skeleton_rmse": {"before": 1.0, "after": 2.0}}


@pytest.mark.parametrize(
    ("take", "level", "words"),
    [
        (FAILED, FIRST, "byte 2: no points."),
        (LEFT, FIRST, "10 samples left; longest LANK 5-14, the expected error is graded poor"),
        (row({**FINDING, "suspicion": False, "level": "error", "marker": None}), FIRST, "exchanged"),
        ({**row(), "breaches": [{"message": "too long"}]}, FIRST, "too long"),
        (REPLACED, SECOND, "3 measured samples replaced, by up to 44.0 mm at LANK 5-14"),
        (FAIR, SECOND, "1 gap filled fair; 21.0 mm expected at LANK 5-14"),
        (SUSPICIOUS, SECOND, "1 suspicion (swap 1), first LTOE 3-9; left as measured"),
        (BENT, SECOND, "bones are 2.00 mm off their lengths after, 1.00 mm before"),
    ],
)
def test_the_reason_is_said_in_words(take, level, words):
    found = attention(take)
    assert found.level == level
    assert found.reasons == (words,)


def test_a_take_without_anything_is_fine():
    assert attention(row()).level == NONE
    assert attention(row()).reasons == ()


def test_what_failed_or_was_left_comes_before_what_may_be_wrong():
    order = [attention(take).points for take in (FAILED, LEFT, REPLACED, SUSPICIOUS, FAIR, row())]
    assert order == sorted(order, reverse=True)
    assert len(set(order)) == len(order)


def test_more_left_needs_a_person_more():
    more = row(gap={**GAP, "samples_filled": 0, "length": 500, "left_because": "x"}, filled=0, left=500)
    assert attention(more).points > attention(LEFT).points


def test_the_paragraph_has_the_numbers_of_the_row():
    text = methods_paragraph(REPLACED)
    for number in ("1,000 samples", "10 (1.00 %)", "10 frames (0.10 s)", "method kriging", "by up to 44.0 mm"):
        assert number in text, number
    assert methods_paragraph(FAILED) == ""
