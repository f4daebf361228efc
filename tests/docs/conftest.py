"""The documents, and the code blocks in them."""

import re
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


class Document(NamedTuple):
    path: Path
    text: str

    def blocks(self, language):
        return [body for name, body in BLOCK.findall(self.text) if name == language]

    def commands(self, program):
        """The lines of shell blocks that call a program, without comments."""
        lines = "".join(self.blocks("sh")).splitlines()
        words = [line.partition("#")[0].strip() for line in lines]
        return [line for line in words if line.split()[:1] == [program]]


def document(name):
    return Document(ROOT / name, (ROOT / name).read_text())


@pytest.fixture(scope="session")
def root():
    return ROOT


@pytest.fixture
def benchmark():
    """Imports a program of benchmarks/ by its name."""
    return import_module


@pytest.fixture(scope="session")
def readme():
    return document("README.md")


@pytest.fixture(scope="session")
def quickstart():
    return document("docs/quickstart.md")


@pytest.fixture(scope="session")
def changelog():
    return document("CHANGELOG.md")


@pytest.fixture(scope="session")
def planner_page():
    return document("docs/planner.md")


@pytest.fixture(scope="session")
def own_planner():
    return document("docs/own_planner.md")


@pytest.fixture(scope="session")
def noise_page():
    return document("docs/noise.md")


@pytest.fixture(scope="session")
def documents(readme, quickstart, changelog, planner_page, own_planner):
    named = {
        document.path for document in (readme, quickstart, changelog, planner_page, own_planner)
    }
    folders = (ROOT / "docs", ROOT / "benchmarks")
    pages = [path for folder in folders for path in sorted(folder.glob("*.md"))]
    others = [path for path in pages if path not in named]
    assert len(others) > 15
    rest = [document(str(path.relative_to(ROOT))) for path in others]
    return (readme, quickstart, changelog, planner_page, own_planner, *rest)
