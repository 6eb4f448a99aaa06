"""A registry of modules by name, of which each is imported when it is first asked for.

Other packages add modules through entry points. These are looked for when a name is not in the registry, or when all
names are asked for, so that a command with the project's own modules does not search the installed packages.
"""

from collections.abc import Callable, Iterable, Iterator, MutableMapping
from contextlib import contextmanager
from importlib import import_module
from typing import TYPE_CHECKING, Any, TypeVar

from mocapclean.errors import MocapcleanError, PackageError, UnknownNameError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

M = TypeVar("M")


class Modules(MutableMapping[str, M]):
    """The modules of a package by their names, in a fixed order.

    A module is imported at its first use. Other objects can be entered under new names. A module of another package is
    found by its name, and is none of those that are iterated over; ``installed`` names them. group: of the entry points
    of other packages, "" for none. needs: the names that such a module must have. fault: a function that returns why
    such a module cannot be used, "" where it can.
    """

    def __init__(
        self,
        package: str,
        names: Iterable[str],
        group: str = "",
        needs: tuple[str, ...] = (),
        fault: Callable[[Any], str] = lambda _: "",
    ) -> None:
        self._package, self._fault = package, fault
        self._modules: dict[str, Any] = dict.fromkeys(names)
        self._group, self._needs = group, needs
        self._foreign: dict[str, Any] = {}

    def __getitem__(self, name: str) -> M:
        """Return a module, imported if need be.

        Raises UnknownNameError, a KeyError, for an unknown name, and PackageError for a module of another package that
        cannot be used.
        """
        if name not in self._modules:
            return self._from_elsewhere(name)
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
        """Whether a name is registered, here or by another package; this imports none of the modules."""
        return name in self._modules or name in self._foreign or any(point.name == name for point in self._points())

    def installed(self) -> list[str]:
        """Return the names that other packages add, sorted."""
        return sorted({point.name for point in self._points()} - {*self._modules})

    def origin(self, name: str) -> str:
        """Return the name and version of the package that adds a module, or "" for one of the project's own."""
        if name in self._modules:
            return ""
        return next((_package_of(point) for point in self._points() if point.name == name), "")

    @contextmanager
    def blamed(self, name: str) -> Iterator[None]:
        """Raise PackageError for any other error in the block, where the module of this name is of another package."""
        try:
            yield
        except MocapcleanError:
            raise
        except (Exception, SystemExit) as fault:
            if name not in self._foreign:
                raise
            what = f"{self._group}: {name} of {self.origin(name)}"
            raise PackageError(f"{what} failed: {type(fault).__name__}: {fault}.") from fault

    def _points(self) -> "list[EntryPoint]":
        """Return the entry points of the installed packages."""
        if not self._group:
            return []
        from importlib.metadata import entry_points  # it takes longer to load than a small take to read

        return list(entry_points(group=self._group))

    def _from_elsewhere(self, name: str) -> M:
        """Return the module that another package has under a name, imported once."""
        if name not in self._foreign:
            points = [point for point in self._points() if point.name == name]
            if not points:
                raise UnknownNameError(f"{self._group or self._package}: no installed package has {name!r}.")
            self._foreign[name] = self._loaded(points)
        module: M = self._foreign[name]
        return module

    def _loaded(self, points: "list[EntryPoint]") -> Any:
        """Return the module of the only entry point of a name; raise PackageError where it cannot be used."""
        point, *others = points
        what = f"{self._group}: {point.name} of {_package_of(point)}"
        if others:
            packages = " and ".join(sorted(map(_package_of, points)))
            raise PackageError(f"{self._group}: {point.name} must be of one package. It is in {packages}.")
        try:
            module = point.load()
        except (Exception, SystemExit) as fault:
            raise PackageError(f"{what} cannot be loaded: {type(fault).__name__}: {fault}.") from fault
        lacking = [needed for needed in self._needs if not hasattr(module, needed)]
        if lacking:
            raise PackageError(f"{what} must have {', '.join(self._needs)}. {', '.join(lacking)} is missing.")
        if wrong := self._fault(module):
            raise PackageError(f"{what} cannot be used: {wrong}.")
        return module


def _package_of(point: "EntryPoint") -> str:
    """Return the name and version of the package of an entry point."""
    return f"{point.dist.name} {point.dist.version}" if point.dist else point.value
