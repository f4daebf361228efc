"""The plug-in's document: its campaigns can be launched, its code runs, its links lead to files."""

import re
from contextlib import closing
from pathlib import Path

import pytest

from eigenfail.cli.specs import check_plugins, read_spec
from eigenfail.values.episode import EpisodeTask, PriorSource
from eigenfail.worlds import world_of
from eigenfail_services.campaigns.validation import check_spec
from eigenfail_workers.engine import Engine

PLUGIN = Path(__file__).parents[1]
TEXT = (PLUGIN / "README.md").read_text()
FILES = {
    match[2]: match[0].partition("\n")[2].removesuffix("```")
    for match in re.finditer(r"```(toml|python)\n# (\S+)\n.*?```", TEXT, re.DOTALL)
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with the files of the document, whose modules are listed."""
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    monkeypatch.setenv("EIGENFAIL_FUNCTIONS", "my_policy,my_margin")
    return tmp_path


def run(path, episodes):
    spec = read_spec(path)
    check_plugins(spec)
    check_spec(spec)
    spec, _ = world_of(spec.simulator).resolve(spec)
    with closing(Engine(spec.setup())) as engine:
        tasks = [EpisodeTask(index, index, PriorSource()) for index in range(episodes)]
        return list(engine.run(tasks))


def test_it_has_these_files():
    assert set(FILES) == {"merge.toml", "cart_pole.toml", "my_margin.py", "my_policy.py"}


@pytest.mark.parametrize("name", ["merge.toml", "cart_pole.toml"])
def test_its_campaigns_run(folder, name):
    results = run(folder / name, 2)
    assert [result.fault for result in results] == [None, None]
    assert [result.digest() for result in run(folder / name, 2)] == [
        result.digest() for result in results
    ]


@pytest.mark.parametrize("name", ["merge.toml", "highway.toml"])
def test_the_examples_can_be_launched(name):
    spec = read_spec(PLUGIN / "examples" / name)
    check_plugins(spec)
    assert check_spec(spec).form.steps == 20


def test_its_links_lead_to_files():
    links = [part.partition(")")[0] for part in TEXT.split("](")[1:]]
    files = [link.partition("#")[0] for link in links if not link.startswith(("http", "#"))]
    assert [file for file in files if not (PLUGIN / file).exists()] == []
