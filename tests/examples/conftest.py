"""Examples as their pages have readers install them."""

import tomllib
from pathlib import Path

import pytest

from eigenfail import plugins

EXAMPLES = Path(__file__).parents[2] / "examples"


def forget():
    plugins.list_entry_points.cache_clear()
    plugins.load.cache_clear()


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Does as pip does with a pyproject.toml: the entry points of its project are found."""

    def write(text):
        project = tomllib.loads(text)["project"]
        groups = project["entry-points"].items()
        lines = [f"[{g}]\n{name} = {at}" for g, own in groups for name, at in own.items()]
        record = tmp_path / f"{project['name'].replace('-', '_')}-0.1.dist-info"
        record.mkdir()
        about = f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: 0.1\n"
        (record / "METADATA").write_text(about)
        (record / "entry_points.txt").write_text("\n".join(lines))
        for folder in (EXAMPLES, tmp_path):
            monkeypatch.syspath_prepend(folder)
        forget()

    yield write
    monkeypatch.undo()
    forget()
