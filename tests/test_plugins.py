"""Nothing knows a plug-in but its own folder, so that the folder can be deleted.

deploy/structure.py finds imports, and deploy/without_plugins.py runs the tests without each folder.
"""

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from eigenfail import plugins
from eigenfail.cli import main

ROOT = Path(__file__).parents[1]
PLUGINS = sorted(file.parent for file in ROOT.glob("plugins/*/pyproject.toml"))
FOLDERS = ("sdk", "api", "services", "workers", "migrations", "tests", "benchmarks", "deploy")
FILES = ("Makefile", "pyproject.toml", "conftest.py", "mkdocs.yml", "constraints.txt")
TEXTS = {".py", ".md", ".toml", ".html", ".js", ".json", ".txt", ".yml", ".yaml", ".sh", ""}
REMEDIES = {f"sdk/eigenfail/{name}.py" for name in ("cli/main", "contracts/recording", "plugins")}
"""Modules whose errors say which package brings what is not installed."""

LINK = re.compile(r"\[[^\]]*\]\([^)]*\)")


def list_texts():
    """The path and the text of every file that must not name a plug-in; links may."""
    paths = [ROOT / name for name in FILES]
    for folder in (*FOLDERS, "docs", "examples"):
        paths += [path for path in (ROOT / folder).rglob("*") if path.suffix in TEXTS]
    for path in paths:
        if path.is_file() and not {"node_modules", "__pycache__"} & set(path.parts):
            text = path.read_text("utf-8", errors="replace")
            yield path.relative_to(ROOT), LINK.sub("", text) if path.suffix == ".md" else text


@pytest.fixture(scope="module")
def texts():
    return dict(list_texts())


def test_no_other_file_names_a_plug_in(texts):
    for folder in PLUGINS:
        packages = [file.parent.name for file in folder.glob("*/__init__.py")]
        assert packages, folder.name
        for name in packages:
            assert [str(path) for path, text in texts.items() if name in text] == [], name
        found = {str(path) for path, text in texts.items() if folder.name in text}
        assert found <= REMEDIES, folder.name


def test_a_plug_in_has_what_it_is_made_of():
    for folder in PLUGINS:
        for name in ("README.md", "pyproject.toml", "tests"):
            assert (folder / name).exists(), (folder.name, name)


@pytest.fixture
def alone(monkeypatch):
    """The core as it is where no other distribution is installed."""
    own = {
        name: points
        for name, points in plugins.list_claims(plugins.COMMANDS).items()
        if plugins.name_distribution(points[0]) == plugins.DISTRIBUTION
    }
    monkeypatch.setattr(plugins, "list_claims", lambda group: own)


def list_commands():
    known = main.typer.main.get_command(main.app).commands
    return [name for name, command in known.items() if not command.hidden]


def test_the_commands_of_the_core_come_first_and_are_the_same_without_plug_ins(request):
    with_plugins = list_commands()
    assert with_plugins[: len(main.COMMANDS)] == list(main.COMMANDS)
    request.getfixturevalue("alone")
    assert list_commands() == list(main.COMMANDS)


@pytest.mark.parametrize("words", [["doctor", "--help"], ["run", "--help"], ["--version"]])
def test_what_the_core_prints_does_not_depend_on_plug_ins(words, request):
    before = CliRunner().invoke(main.app, words).stdout
    request.getfixturevalue("alone")
    assert CliRunner().invoke(main.app, words).stdout == before
