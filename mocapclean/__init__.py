"""mocapclean cleans motion-capture files: it detects untrustworthy samples and fills them, and changes nothing else.

The public names are imported on first use, so that the command starts quickly.
"""

TYPE_CHECKING = False  # type checkers read True; importing typing for its constant would slow the start
if TYPE_CHECKING:
    from mocapclean.detection import detect
    from mocapclean.formats import read, write
    from mocapclean.pipeline.fill import FillResult, fill
    from mocapclean.take import Take
    from mocapclean.take.status import Status
    from mocapclean.take.tables import from_xarray

__version__ = "0.1.0"

_MODULE_OF = {
    "read": "mocapclean.formats",
    "write": "mocapclean.formats",
    "fill": "mocapclean.pipeline.fill",
    "FillResult": "mocapclean.pipeline.fill",
    "detect": "mocapclean.detection",
    "Take": "mocapclean.take.take",
    "Status": "mocapclean.take.status",
    "from_xarray": "mocapclean.take.tables",
}

__all__ = ["FillResult", "Status", "Take", "__version__", "detect", "fill", "from_xarray", "read", "write"]


def __getattr__(name: str) -> object:
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'mocapclean' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(_MODULE_OF[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
