"""What a machine lets a run use."""

import multiprocessing
import os

import pytest

from mocapclean.batch.limits import memory_limit, processors

AVAILABLE = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()


def machine(root, groups, **files):
    (root / "proc" / "self").mkdir(parents=True)
    (root / "proc" / "self" / "cgroup").write_text(groups)
    for name, text in files.items():
        path = root / "sys" / "fs" / "cgroup" / name.replace("__", "/").replace("_DOT_", ".")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return root


V2 = "0::/job.slice/step\n"
V1 = "5:cpu,cpuacct:/docker/abc\n4:memory:/docker/abc\n"


@pytest.mark.parametrize(
    ("groups", "files", "allowed"),
    [
        (V2, {"cpu_DOT_max": "max 100000\n"}, AVAILABLE),
        (V2, {"cpu_DOT_max": "100000 100000\n"}, 1),
        (V2, {"job.slice__cpu_DOT_max": "50000 100000\n"}, 1),
        (V2, {"job.slice__step__cpu_DOT_max": "50000 100000\n", "cpu_DOT_max": "max 100000\n"}, 1),
        (V2, {"job.slice__step__cpu_DOT_max": "6400000 100000\n"}, min(AVAILABLE, 64)),
        (V2, {}, AVAILABLE),
        (V1, {"cpu__docker__abc__cpu.cfs_quota_us": "100000", "cpu__docker__abc__cpu.cfs_period_us": "100000"}, 1),
        (V1, {"cpu__cpu.cfs_quota_us": "-1", "cpu__cpu.cfs_period_us": "100000"}, AVAILABLE),
    ],
)
def test_processors_are_those_of_the_control_groups(tmp_path, groups, files, allowed):
    assert processors(machine(tmp_path, groups, **files)) == allowed


def test_without_control_groups_it_is_the_affinity(tmp_path):
    assert processors(tmp_path) == AVAILABLE


def _allocate(sizes):
    import numpy as np

    for size, allowed in sizes:
        with memory_limit(100 << 20):
            try:
                np.ones(size << 20, dtype=np.uint8)
                assert allowed
            except MemoryError:
                assert not allowed
    np.ones(300 << 20, dtype=np.uint8)


def test_memory_beyond_the_limit_is_an_error_that_can_be_caught():
    context = multiprocessing.get_context("spawn")
    process = context.Process(target=_allocate, args=([(60, True), (200, False), (60, True)],))
    process.start()
    process.join()
    assert process.exitcode == 0
