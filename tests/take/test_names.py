"""Subjects, wildcards and similar names of markers."""

import pytest

from mocapclean.take.names import bare_name, is_pattern, matching_columns, similar_names, split_subject

MARKERS = ("Ann:LKNE", "Ann:RKNE", "Bob:LKNE", "LKNE", "*12", "rest[1]")


@pytest.mark.parametrize(
    ("marker", "parts"),
    [("LKNE", ("", "LKNE")), ("Ann:LKNE", ("Ann", "LKNE")), ("Set:Ann:LKNE", ("Set:Ann", "LKNE")), (":x", ("", "x"))],
)
def test_the_last_colon_separates_the_subject(marker, parts):
    assert split_subject(marker) == parts
    assert bare_name(marker) == parts[1]


@pytest.mark.parametrize(
    ("pattern", "columns"),
    [
        ("LKNE", [0, 2, 3]),
        ("Ann:LKNE", [0]),
        ("Ann:*", [0, 1]),
        ("?KNE", [0, 1, 2, 3]),
        ("[RX]KNE", [1]),
        ("lkne", []),
        ("*12", [4]),
        ("rest[1]", [5]),
        ("", []),
    ],
)
def test_patterns_match_names_with_and_without_their_subject(pattern, columns):
    assert matching_columns(pattern, MARKERS) == columns


@pytest.mark.parametrize(("name", "expected"), [("L*", True), ("?", True), ("x[1]", True), ("Ann:LKNE", False)])
def test_wildcards_make_a_pattern(name, expected):
    assert is_pattern(name) == expected


def test_similar_names_are_at_most_three_and_the_best_come_first():
    assert similar_names("LKNEE", MARKERS)[0] == "LKNE"
    assert len(similar_names("Ann:LKNE", MARKERS)) == 3
    assert similar_names("completely different", MARKERS) == []
    assert similar_names("LKNE", ["LTOE"]) == []
    assert similar_names("LKNE", ["LTOE"], cutoff=0.5) == ["LTOE"]
