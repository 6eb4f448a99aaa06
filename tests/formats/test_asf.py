"""ASF: which skeletons are refused, and with what sentence."""

import re
from pathlib import Path

import numpy as np
import pytest
from test_amc import ASF, TEXT, UNIT, load, save

from mocapclean.errors import FormatError


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b":bonedata", b":bones", "must have a section :bonedata"),
        (ASF[ASF.index(b":hierarchy") :], b"", "must have a section :hierarchy"),
        (b"length 0.45", b"length 0", ":units must have a length of 1e-6 or more and an angle of deg or rad"),
        (b"length 0.45", b"length 1e-320", ":units must have a length of 1e-6 or more and an angle of deg or rad"),
        (b"length 0.45", b"length long", "line 6: a number must be decimal"),
        (b"angle deg", b"angle grad", "Got 0.45 and 'grad'"),
        (b"TX TY TZ", b"TX TX TZ", "line 11: a degree of freedom must stand once"),
        (b"TX TY TZ", b"TX TY TQ", "line 11: a degree of freedom must be one of tx ty tz rx ry rz. Got 'tq'"),
        (b"dof rx rz", b"dof rx l", "bones that stretch or slide are not read. Got 'l'"),
        (b"dof rx rz", b"dof tx rz", "bones that stretch or slide are not read. Got 'tx'"),
        (b"axis 10 -5 20  XYZ", b"axis 10 -5 20  XXZ", "line 28: an axis must be three angles and an order"),
        (b"direction 0 1 0", b"direction 0 0 0", "line 48: bone 'chest' must have a direction"),
        (b"direction 0 1 0", b"direction 0 1", "line 47: direction must be 3 finite number"),
        (b"     name chest\n", b"", "a bone must have a name. Got none"),
        (b"name chest", b"name root", "distinct names, and none the name root"),
        (b"name chest", b"name breast", "the hierarchy must name bones of :bonedata. Got 'chest'"),
        (b"root hip chest", b"root hip", "every bone must be connected to the root. Got 'chest'"),
        (b"femur tibia", b"femur tibia hip", "a bone must have one parent. Got a second for 'hip'"),
        (b"hip femur", b"tibia femur", "every bone must be connected to the root"),
        (b"  end\n:hierarchy", b":hierarchy", "every begin must have its end"),
        (b"  end\n  begin", b"  begin", "begin and end must take turns"),
    ],
)
def test_bad_skeleton_is_one_clear_sentence(tmp_path: Path, old: bytes, new: bytes, message: str) -> None:
    assert old in ASF
    with pytest.raises(FormatError) as caught:
        load(save(tmp_path, TEXT, ASF.replace(old, new, 1)))
    assert re.search(message, str(caught.value))
    assert str(caught.value).startswith(str(tmp_path / "05.asf"))


def test_another_subjects_skeleton_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"'femur' must have 1 numbers, as in 05\.asf\. Got 3.*another subject's"):
        load(save(tmp_path, TEXT, ASF.replace(b"dof rx ry rz\n    limits", b"dof rx\n    limits")))


def test_a_chain_of_thousands_of_bones_is_read(tmp_path: Path) -> None:
    bone = b"begin\nname b%d\ndirection 0 1 0\nlength 1\nend\n"
    n_bones = 3000
    asf = ASF[: ASF.index(b"  begin")] + b"".join(bone % i for i in range(n_bones)) + b":hierarchy\nbegin\nroot b0\n"
    asf += b"".join(b"b%d b%d\n" % (i, i + 1) for i in range(n_bones - 1)) + b"end\n"
    take = load(save(tmp_path, b"1\nroot 0 0 0 0 0 0\n", asf))
    np.testing.assert_allclose(take.positions[0, -1], [0, n_bones * UNIT, 0])


def test_cut_skeleton_is_refused(tmp_path: Path) -> None:
    for size in range(len(ASF) - len(b"end\n")):
        with pytest.raises(FormatError):
            load(save(tmp_path, TEXT, ASF[:size]))
