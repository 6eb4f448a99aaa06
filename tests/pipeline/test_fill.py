"""``mocapclean.fill``: one result, with the same samples, status and numbers as the command."""

import dataclasses
import json

import numpy as np
import pytest
from click.testing import CliRunner

import mocapclean
from mocapclean.cli import cli
from mocapclean.errors import UsageError
from mocapclean.take.status import Status
from tests.conftest import SAMPLES

CASES = {
    "default": ({}, []),
    "limits": ({"max_gap": 30, "max_error": 1.0}, ["--max-gap", "30", "--max-error", "1"]),
    "markers": (
        {"method": "spline", "markers": ["L*"], "self_check": False},
        ["--method", "spline", "--markers", "L*", "--no-self-check"],
    ),
}


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """A file of 150 frames of 14 markers, with gaps."""
    path = tmp_path_factory.mktemp("small") / "walk.c3d"
    take = mocapclean.read(SAMPLES / "walk.c3d").crop(100, 250)
    mocapclean.write(take.select(np.arange(14)), path)
    return path


def command(source, tmp_path, *options):
    """The bytes of the output, the row of the report, and the arrays of the command."""
    out, arrays = tmp_path / "out.c3d", tmp_path / "out.npz"
    arguments = ["fill", str(source), "-o", str(out), "--sidecar", str(arrays), "--json", *options]
    done = CliRunner().invoke(cli, arguments)
    assert done.exit_code == 0, done.stderr
    return out.read_bytes(), json.loads(done.stdout)["takes"][0], np.load(arrays)


@pytest.mark.parametrize("case", CASES)
def test_the_function_and_the_command_fill_alike(source, tmp_path, case):
    options, arguments = CASES[case]
    content, row, arrays = command(source, tmp_path, *arguments)
    take = mocapclean.detect(mocapclean.read(source))
    assert not take.trusted.all()
    result = mocapclean.fill(take, **options)
    mocapclean.write(result.take, tmp_path / "python.c3d")
    assert (tmp_path / "python.c3d").read_bytes() == content
    assert np.array_equal(result.status, arrays["status"])
    if result.sd is not None:
        supplied = result.take.filled
        np.testing.assert_allclose(result.sd[supplied], arrays["sd"][supplied], rtol=1e-12)
    assert result.method == row["method"]
    assert (result.counts.filled, result.counts.left) == (row["counts"]["filled"], row["counts"]["left"])
    assert [gap.grade or None for gap in result.gaps] == [gap["grade"] for gap in row["gaps"]]
    assert [gap.status.code for gap in result.gaps] == [gap["status"] for gap in row["gaps"]]
    assert sum(result.grades.values()) == sum(bool(gap.grade) for gap in result.gaps)
    assert (result.self_check is None) == (row["self_check"] is None)


def test_auto_tells_what_it_chose(source):
    result = mocapclean.fill(mocapclean.read(source), "auto")
    assert result.choice.method == result.method
    assert result.self_check.total.error.samples > 0
    assert result.method in repr(result)


def test_nothing_is_detected_and_a_gap_of_the_file_is_missing():
    take = mocapclean.read(SAMPLES / "walk.c3d")
    result = mocapclean.fill(take, "linear", self_check=False)
    assert np.array_equal(result.take.trusted, take.trusted)
    assert {*np.unique(result.status[~take.trusted])} == {Status.FILLED, Status.AT_END}
    assert result.sd is None
    assert result.self_check is None


def test_write_takes_the_take_of_the_result(source, tmp_path):
    result = mocapclean.fill(mocapclean.read(source), "linear", self_check=False)
    with pytest.raises(UsageError, match=r"the attribute take of what fill returns\. Got FillResult"):
        mocapclean.write(result, tmp_path / "out.c3d")
    assert mocapclean.write(result.take, tmp_path / "out.c3d").filled.any()


def test_samples_that_the_caller_distrusts_are_missing_and_those_of_a_rule_are_replaced():
    take = mocapclean.read(SAMPLES / "walk.c3d").crop(0, 120)
    spiked = take.positions.copy()
    column = next(k for k in range(len(take.markers)) if take.trusted[:, k].all())
    spiked[60, column] += 400.0
    take = mocapclean.detect(dataclasses.replace(take, positions=spiked))
    assert not take.trusted[60, column]
    trusted = take.trusted.copy()
    trusted[30:40, column] = False
    status = mocapclean.fill(dataclasses.replace(take, trusted=trusted), self_check=False).status
    assert status[60, column] == Status.REPLACED
    assert (status[30:40, column] == Status.FILLED).all()


def test_one_marker_needs_no_list():
    take = mocapclean.detect(mocapclean.read(SAMPLES / "walk.c3d"))
    one, listed = (mocapclean.fill(take, "linear", markers=markers, self_check=False) for markers in ("LF*", ["LF*"]))
    assert one.counts == listed.counts
    assert 0 < one.counts.filled < one.counts.untrusted


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "nobody"}, "a method must be one of"),
        ({"method": "auto", "rank": 3}, "method auto has no parameters. Got rank."),
        ({"method": "svt", "tolerance": -1.0}, "the parameters of svt must be valid. tolerance"),
        ({"max_gap": 0}, "the options of fill must be valid. max_gap"),
        ({"markers": ["NOBODY"]}, "markers must name markers of the take"),
        (
            {"method": "spline", "max_gp": 3},
            "nor a parameter of spline. Did you mean 'max_gap'?",
        ),
        ({"method": "linear", "max_error": 3.0}, "max_error must go with a method that gives error bars"),
    ],
)
def test_a_wrong_call_gets_one_sentence(options, message):
    with pytest.raises(UsageError) as refused:
        mocapclean.fill(mocapclean.read(SAMPLES / "walk.c3d"), **options)
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)
