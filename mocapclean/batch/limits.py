"""How much of a machine a run may use: processors for all takes, memory and time for each."""

import contextlib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil
from pathlib import Path

from mocapclean.errors import UsageError

_ROOT = Path("/")


@dataclass(frozen=True, kw_only=True)
class Limits:
    """workers: processes at a time; 0: none but this one. timeout (seconds), memory (bytes): of one take, or None."""

    workers: int = 1
    timeout: float | None = None
    memory: int | None = None


def processors(root: Path = _ROOT) -> int:
    """The processors that this process may use: its affinity, and the quota of its control groups (v2 or v1)."""
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min([allowed, *(ceil(quota) for quota in _quotas(root))]))


def _quotas(root: Path) -> Iterator[float]:
    """The quota, in processors, of every control group that this process is in, from its own up to the root's."""
    try:
        groups = [line.split(":", 2) for line in (root / "proc/self/cgroup").read_text().splitlines()]
    except OSError:
        return
    for _, controllers, place in groups:
        v2 = not controllers
        if not v2 and "cpu" not in controllers.split(","):
            continue
        top = root / "sys/fs/cgroup" / ("" if v2 else "cpu")
        own = top / place.strip("/")
        for folder in (own, *own.parents[: len(own.parts) - len(top.parts)]):
            words = _words(folder, ("cpu.max",) if v2 else ("cpu.cfs_quota_us", "cpu.cfs_period_us"))
            if len(words) == 2 and words[0] not in ("max", "-1"):
                yield int(words[0]) / int(words[1])


def _words(folder: Path, names: tuple[str, ...]) -> list[str]:
    with contextlib.suppress(OSError):
        return " ".join((folder / name).read_text() for name in names).split()
    return []


@contextlib.contextmanager
def memory_limit(memory: int | None) -> Iterator[None]:
    """Let this process take at most so many bytes more than it has; more than that is a MemoryError.

    Raises UsageError on systems that cannot limit a process (Windows).
    """
    if memory is None:
        yield
        return
    try:
        import resource
    except ImportError:
        raise UsageError("--memory must be left out: this system cannot limit the memory of a process.") from None
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    wanted = _mapped(resource.getpagesize()) + memory
    resource.setrlimit(resource.RLIMIT_AS, (wanted if hard == resource.RLIM_INFINITY else min(wanted, hard), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def _mapped(page: int) -> int:
    """The bytes of address space that this process has mapped, or 0 where the system does not say."""
    try:
        return int(Path("/proc/self/statm").read_text().split()[0]) * page
    except OSError:
        return 0
