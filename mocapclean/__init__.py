"""mocapclean cleans motion-capture files: it detects what cannot be trusted and fills it, changing nothing else.

The public names are loaded on first use, so that the command starts at once.
"""

TYPE_CHECKING = False  # as typing.TYPE_CHECKING, without the time that importing typing takes
if TYPE_CHECKING:
    from mocapclean.detection import detect
    from mocapclean.formats import read, write
    from mocapclean.pipeline.filling import fill
    from mocapclean.take import Take

__version__ = "0.1.0"

_HOMES = {
    "read": "mocapclean.formats",
    "write": "mocapclean.formats",
    "fill": "mocapclean.pipeline.filling",
    "detect": "mocapclean.detection",
    "Take": "mocapclean.take.take",
}

__all__ = ["Take", "__version__", "detect", "fill", "read", "write"]


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'mocapclean' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(_HOMES[name]), name)
