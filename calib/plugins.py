"""Classes of the user's own, in installed packages that announce them by an entry point."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib.metadata import entry_points
from typing import TypeVar

from calib.errors import CalibError

T = TypeVar("T")


def with_announced(
    group: str, own: Mapping[str, type[T]], kind: type[T], name_of: Callable[[type[T]], str]
) -> dict[str, type[T]]:
    """Our classes by name, and those of installed packages.

    group : entry points are in ``posecal.<group>``, a class under the name it gives itself
    kind : what they must be subclasses of; name_of : how a class says its name

    Raises CalibError where a package announces something else.
    """
    found, what = dict(own), group.removesuffix("s") if group != "criteria" else "criterion"
    for entry in entry_points(group=f"posecal.{group}"):
        said = f"{what} {entry.name!r}"
        if entry.name in found:
            raise CalibError(f"{said} of {entry.value}: the name is taken")
        try:
            theirs = entry.load()
        except Exception as error:  # whatever a foreign package raises becomes one line
            raise CalibError(f"{said}: {entry.value} fails to load: {error}") from None
        if not (isinstance(theirs, type) and issubclass(theirs, kind)):
            raise CalibError(f"{said}: {entry.value} is no subclass of {kind.__name__}")
        if name_of(theirs) != entry.name:
            raise CalibError(f"{said}: {entry.value} calls itself {name_of(theirs)!r}")
        found[entry.name] = theirs
    return found
