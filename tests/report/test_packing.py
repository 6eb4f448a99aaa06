"""What is packed is what a reader of the text gets, to half a step."""

import base64
import json
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from mocapclean.report.page.packing import Packer

NUMBERS = st.floats(-2e7, 2e7) | st.sampled_from([np.nan, np.inf, 0.004, -0.005])


def unpacked(text):
    """The header and the arrays in a text, read as unpacking.js does."""
    data = zlib.decompress(base64.b64decode(text))
    length = int.from_bytes(data[:4], "little")
    header = json.loads(data[4 : 4 + length])
    found = {}
    for name, block in header["arrays"].items():
        size = int(np.prod(block["shape"]))
        start = 4 + length + block["offset"]
        if block["kind"] == "bytes":
            found[name] = np.frombuffer(data, np.uint8, size, start).reshape(block["shape"])
            continue
        planes = np.frombuffer(data, np.uint8, 4 * size, start).reshape(4, size).T
        codes = np.ascontiguousarray(planes).view("<u4").ravel()
        whole = ((codes >> 1) ^ -(codes & 1)).astype(np.int32).reshape(block["shape"])
        for _ in range(2 if block["kind"] == "series" else 1):
            whole = np.cumsum(whole, axis=-1, dtype=np.int32)
        found[name] = whole * block["step"]
    return header, found


@given(arrays.arrays(np.float64, st.tuples(st.integers(1, 12), st.integers(1, 4)), elements=NUMBERS))
def test_series_come_back_to_half_a_step(values):
    packer = Packer()
    packer.add_series("one", values, 0.01)
    _, found = unpacked(packer.text({}))
    finite = np.isfinite(values)
    assert np.abs(found["one"].T - values)[finite].max(initial=0.0) <= 0.005 + 1e-6


@given(arrays.arrays(np.float64, st.integers(0, 20), elements=st.floats(-1e6, 1e6)))
def test_numbers_come_back_to_half_a_step(values):
    packer = Packer()
    packer.add_numbers("one", values, 0.01)
    packer.add_numbers("places", np.arange(len(values)) * 7, 1.0)
    _, found = unpacked(packer.text({}))
    assert np.abs(found["one"] - values).max(initial=0.0) <= 0.005 + 1e-6
    assert np.array_equal(found["places"], np.arange(len(values)) * 7)


@pytest.mark.parametrize("name", ["<script>alert(1)</script>", "ä" * 500, "\ud800", '"]]>-->'])
def test_no_text_needs_an_escape(name):
    packer = Packer()
    packer.add_codes("codes", np.array([[1, 2], [3, 4], [5, 6]], dtype=np.uint8))
    text = packer.text({"name": name})
    assert text.isascii()
    assert not set(text) & set("<>&\"'\\")
    header, found = unpacked(text)
    assert header["name"] == name
    assert np.array_equal(found["codes"], [[1, 3, 5], [2, 4, 6]])


def test_a_minute_of_motion_is_small():
    rng = np.random.default_rng(1)
    time = np.arange(7200) / 120
    motion = np.stack([400 * np.sin(6 * time + phase) for phase in rng.uniform(0, 6, 41 * 3)], axis=1)
    packer = Packer()
    packer.add_series("after", motion + rng.normal(0, 0.3, motion.shape), 0.01)
    assert len(packer.text({})) < 3e6
