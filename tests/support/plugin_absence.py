"""The core without the plug-ins of this repository, whichever are installed."""

from collections.abc import Iterator
from importlib.metadata import EntryPoint
from pathlib import Path

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
        forget_entry_points()
        yield
    forget_entry_points()


def forget_entry_points() -> None:
    """Have entry points read anew, and databases in memory made with the tables that they name."""
    from eigenfail_services.store import store

    for each in (plugins.list_entry_points, plugins.load, store._empty_image):
        each.cache_clear()
