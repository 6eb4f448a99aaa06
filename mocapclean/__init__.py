"""mocapclean cleans motion-capture files: it detects what cannot be trusted and fills it, changing nothing else.

The public names are loaded on first use, so that the command starts at once.
"""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

_HOMES = {
    "read": "mocapclean.formats",
    "write": "mocapclean.formats",
    "fill": "mocapclean.repair",
    "detect": "mocapclean.trust",
    "Take": "mocapclean.records",
}

__all__ = ["Take", "__version__", "detect", "fill", "read", "write"]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'mocapclean' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
