"""What a repair does with a take that its file cannot hold."""

import numpy as np

from mocapclean.config.loading import resolve
from mocapclean.formats import read
from mocapclean.pipeline.repair import repair
from mocapclean.take.status import Status
from tests.c3d_builder import C3D


def test_a_gap_beyond_the_numbers_of_the_file_is_left_and_the_others_are_filled(tmp_path):
    """Integers of a tenth of a millimetre end at 3276.7 mm; M1 is 500 mm ahead of a body that walks up to that."""
    rng = np.random.default_rng(5)
    ahead = np.vstack([[5000.0, 0.0, 0.0], rng.integers(-900, 900, (7, 3))])
    places = np.stack([np.linspace(0, 30000, 400), 3000 * np.sin(np.arange(400) / 30), np.full(400, 9000.0)], axis=1)
    points = np.zeros((400, 8, 4))
    points[..., :3] = np.round(places[:, None] + ahead)
    beyond = points[:, 0, 0] > 32767
    points[beyond, 0] = [0, 0, 0, -1]
    points[100:140, 3] = [0, 0, 0, -1]
    source, output = tmp_path / "take.c3d", tmp_path / "out.c3d"
    source.write_bytes(C3D(points, is_float=False).build())
    outcome = repair(source, output, resolve(None, {"trust": {}, "fill_poor": True}))
    assert outcome.status == "repaired", outcome.error
    assert {gap.marker: gap.status for gap in outcome.gaps} == {"M1": Status.OUT_OF_RANGE, "M4": Status.FILLED}
    assert outcome.statuses[Status.OUT_OF_RANGE] == beyond.sum()
    before, after = read(source), read(output)
    assert after.trusted[100:140, 3].all()
    assert not after.trusted[beyond, 0].any()
    assert np.array_equal(after.positions[before.trusted], before.positions[before.trusted])
