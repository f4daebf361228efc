"""Examples as their pages have readers install them."""

import tomllib
from pathlib import Path

import pytest
from distributions import write_record
from plugin_absence import forget_entry_points

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Does as pip does with a pyproject.toml: the entry points of its project are found."""

    def write(text):
        project = tomllib.loads(text)["project"]
        groups = project["entry-points"].items()
        lines = [f"[{g}]\n{name} = {at}" for g, own in groups for name, at in own.items()]
        write_record(tmp_path, project["name"], "\n".join(lines), "0.1")
        for folder in (EXAMPLES, tmp_path):
            monkeypatch.syspath_prepend(folder)
        forget_entry_points()

    yield write
    monkeypatch.undo()
    forget_entry_points()
