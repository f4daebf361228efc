"""The core without the plug-ins of this repository, whichever are installed."""

import sys
from collections.abc import Callable, Iterator
from functools import cache
from importlib.metadata import EntryPoint
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from eigenfail import plugins

ROOT = Path(__file__).parents[2]
FOLDERS = frozenset(file.parent.name for file in ROOT.glob("plugins/*/pyproject.toml"))


@pytest.fixture
def without_plugins() -> Iterator[None]:
    """Hides the plug-ins: texts that list what is installed are then the same everywhere."""
    list_all = plugins.list_claims

    def list_others(group: str) -> dict[str, list[EntryPoint]]:
        return {
            name: points
            for name, points in list_all(group).items()
            if plugins.name_distribution(points[0]) not in FOLDERS
        }

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plugins, "list_claims", list_others)
        for module, name, hidden in make_caches(*sys.path):
            patch.setattr(module, name, hidden)
        yield


@cache
def make_caches(*path: str) -> list[tuple[ModuleType, str, Callable[..., object]]]:
    """Caches for all tests without plug-ins that look for entry points in the same folders."""
    return [(module, name, cache(found.__wrapped__)) for module, name, found in find_caches()]


def find_caches() -> Iterator[tuple[ModuleType, str, Any]]:
    """What is kept of entry points. A database in memory has the tables that they name."""
    from eigenfail_services.store import store

    for name in ("list_entry_points", "load"):
        yield plugins, name, getattr(plugins, name)
    yield store, "_empty_image", store._empty_image


def forget_entry_points() -> None:
    """Have entry points read anew, and databases in memory made anew."""
    for _, _, found in find_caches():
        found.cache_clear()
