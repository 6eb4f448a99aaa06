"""Python on this system without what Windows does not have: loaded by each process that finds this folder first.

Modules and functions of Unix are taken away, and opening, renaming and forcing files to the disk fail as they do there.
"""

import builtins
import fcntl
import io
import os
import signal
import sys

ABSENT = {"fcntl", "resource", "termios", "pwd", "grp", "syslog"}
HANDLED = {signal.SIGABRT, signal.SIGFPE, signal.SIGILL, signal.SIGINT, signal.SIGSEGV, signal.SIGTERM}
_flags, _getfl = fcntl.fcntl, fcntl.F_GETFL
_open, _fsync, _signal, _listdir, _readlink = io.open, os.fsync, signal.signal, os.listdir, os.readlink


class Absent:
    """Finds no module of Unix."""

    @staticmethod
    def find_spec(name, path=None, target=None):
        if name in ABSENT:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


def open_without_proc(file, *arguments, **options):
    if str(file).startswith(("/proc", "/sys")):
        raise FileNotFoundError(2, "No such file or directory", file)
    return _open(file, *arguments, **options)


def fsync(descriptor):
    if _flags(descriptor, _getfl) & os.O_ACCMODE == os.O_RDONLY:
        raise OSError(9, "Bad file descriptor")
    _fsync(descriptor)


def set_signal(number, handler):
    if number not in HANDLED:
        raise ValueError("invalid signal value")
    return _signal(number, handler)


def is_open(path):
    """Whether this process has a file open."""
    real = os.path.realpath(path)
    for descriptor in _listdir("/proc/self/fd"):
        try:
            if _readlink(f"/proc/self/fd/{descriptor}") == real:
                return True
        except OSError:
            continue
    return False


def refusing_open_files(name):
    """The function of ``os``, which fails for a file that is open, as that of Windows does."""
    real = getattr(os, name)

    def refuse(*paths, **options):
        for path in paths:
            if not isinstance(path, int) and options == {} and is_open(path):
                raise PermissionError(13, "The process cannot access the file", path)
        return real(*paths, **options)

    return refuse


for module in ABSENT:
    sys.modules.pop(module, None)
sys.meta_path.insert(0, Absent)
builtins.open = io.open = open_without_proc
os.fsync, signal.signal = fsync, set_signal
for function in ("replace", "rename", "unlink", "remove"):
    setattr(os, function, refusing_open_files(function))
for function in ("fork", "forkpty", "register_at_fork", "sched_getaffinity", "getuid", "geteuid", "getgid", "killpg"):
    delattr(os, function)
for function in (
    "SIGHUP",
    "SIGKILL",
    "SIGUSR1",
    "SIGUSR2",
    "SIGALRM",
    "SIGCHLD",
    "alarm",
    "setitimer",
    "pthread_sigmask",
):
    delattr(signal, function)

import multiprocessing  # noqa: E402  after fork is gone, as it is there when the module is first loaded

multiprocessing.set_start_method("spawn")
multiprocessing.get_all_start_methods = lambda: ["spawn"]
