"""Limits on what a run uses: processors for all takes; memory and time for each take."""

import contextlib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil
from pathlib import Path
from types import ModuleType

from mocapclean.errors import UsageError

_ROOT = Path("/")


@dataclass(frozen=True, kw_only=True)
class WorkerLimits:
    """Worker processes (0: run in this process), and what one take may use: cores, seconds and bytes of memory.

    A take in a worker process uses one core.
    """

    workers: int = 1
    cores: int = 1
    timeout: float | None = None
    memory: int | None = None


def processors(root: Path = _ROOT) -> int:
    """Return the number of processors that this process may use.

    Its CPU affinity and the quotas of its Linux control groups (v2 or v1) limit the number. root: of the file system.
    """
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min([allowed, *(ceil(quota) for quota in _quotas(root))]))


def _quotas(root: Path) -> Iterator[float]:
    """Yield the quotas, in processors, of this process's control groups and all groups above them."""
    try:
        groups = [line.split(":", 2) for line in (root / "proc/self/cgroup").read_text(encoding="utf-8").splitlines()]
    except OSError:
        return
    for _, controllers, path in groups:
        is_v2 = not controllers
        if not is_v2 and "cpu" not in controllers.split(","):
            continue
        top = root / "sys/fs/cgroup" / ("" if is_v2 else "cpu")
        own = top / path.strip("/")
        for folder in (own, *own.parents[: len(own.parts) - len(top.parts)]):
            words = _words(folder, ("cpu.max",) if is_v2 else ("cpu.cfs_quota_us", "cpu.cfs_period_us"))
            if len(words) == 2 and words[0] not in ("max", "-1"):
                yield int(words[0]) / int(words[1])


def _words(folder: Path, names: tuple[str, ...]) -> list[str]:
    """Return the words of some files, in order; none if a file cannot be read."""
    with contextlib.suppress(OSError):
        return " ".join((folder / name).read_text(encoding="ascii") for name in names).split()
    return []


def memory_limiter() -> ModuleType:
    """Return the module that limits the memory of this process; raise UsageError where there is none: on Windows."""
    try:
        import resource
    except ImportError:
        raise UsageError("--memory must be left out: this system cannot limit the memory of a process.") from None
    return resource


@contextlib.contextmanager
def memory_limit(memory: int | None) -> Iterator[None]:
    """Let this process allocate at most ``memory`` bytes more than it holds; beyond that Python raises MemoryError.

    Raises UsageError on Windows, which cannot limit the memory of a process.
    """
    if memory is None:
        yield
        return
    resource = memory_limiter()
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    wanted = _mapped_bytes(resource.getpagesize()) + memory
    resource.setrlimit(resource.RLIMIT_AS, (wanted if hard == resource.RLIM_INFINITY else min(wanted, hard), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def _mapped_bytes(page: int) -> int:
    """Return the bytes of address space that this process has mapped; 0 on systems without /proc."""
    try:
        return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * page
    except OSError:
        return 0
