"""Checks that the store passes on every database.

Each check gets an empty store of its own.
"""

from collections.abc import Callable
from importlib import import_module
from inspect import Signature, isfunction, signature
from pkgutil import iter_modules
from types import ModuleType

from eigenfail_services.store.store import Store

Check = Callable[[Store], None]


def find_checks(module: ModuleType) -> list[Check]:
    """The functions of a module that take a store alone, and return nothing."""
    return [
        each
        for each in vars(module).values()
        if isfunction(each)
        and each.__module__ == module.__name__
        and [*signature(each).parameters] == ["store"]
        and signature(each).return_annotation in {None, Signature.empty}
    ]


STORE_CHECKS: tuple[Check, ...] = tuple(
    check
    for module in iter_modules(__path__)
    for check in find_checks(import_module(f"{__name__}.{module.name}"))
)
"""One behaviour each; raise AssertionError where it is broken."""
