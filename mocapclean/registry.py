"""A registry of modules by name, of which each is imported when it is first asked for."""

from collections.abc import Iterable, Iterator, MutableMapping
from importlib import import_module
from typing import Any, TypeVar

M = TypeVar("M")


class Modules(MutableMapping[str, M]):
    """The modules of a package by their names, in a fixed order.

    A module is imported at its first use. Other objects can be entered under new names.
    """

    def __init__(self, package: str, names: Iterable[str]) -> None:
        self._package = package
        self._modules: dict[str, Any] = dict.fromkeys(names)

    def __getitem__(self, name: str) -> M:
        """Return a module, imported if need be; raise KeyError for an unknown name."""
        if self._modules[name] is None:
            self._modules[name] = import_module(f"{self._package}.{name}")
        module: M = self._modules[name]
        return module

    def __setitem__(self, name: str, module: M) -> None:
        self._modules[name] = module

    def __delitem__(self, name: str) -> None:
        del self._modules[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._modules)

    def __len__(self) -> int:
        return len(self._modules)

    def __contains__(self, name: object) -> bool:
        """Whether a name is registered; this imports nothing."""
        return name in self._modules
