"""A baseline that is made once, and a gate that judges planners by it."""

import json
from contextlib import closing

import pytest
from msgspec.structs import replace
from typer.testing import CliRunner

from eigenfail.cli.connection import Environment
from eigenfail.cli.main import app
from eigenfail.client import Client
from eigenfail_services.campaigns import analysis_jobs
from eigenfail_services.store.engine import WAIT_S, Database
from eigenfail_services.store.sqlite import SqliteMemory
from eigenfail_services.store.store import Store, open_store

SUITE = """
name = "trio"
[base]
method = "{method}"
planner = "idm"
simulator = "point_mass"
episodes = 16
[base.planner_settings]
lane_half_width_m = {width}
[[campaigns]]
name = "one"
seed = 1
[[campaigns]]
name = "two"
seed = 2
"""

LANES_M = {"usual": 2.25, "better": 3.0, "worse": 1.5}
"""The planner's lane: the wider, the earlier it heeds who comes in."""


def content(planner, method="monte_carlo"):
    return SUITE.format(width=LANES_M[planner], method=method)


@pytest.fixture
def suite(tmp_path):
    """Writes the suite with a planner of this kind."""

    def write(planner="usual", name="trio.toml", more="", method="monte_carlo"):
        file = tmp_path / name
        file.write_text(content(planner, method) + more)
        return file

    return write


@pytest.fixture(scope="package")
def made(tmp_path_factory, working_service):
    """The image of a store with a baseline of version v1, and what was said of it."""
    file = tmp_path_factory.mktemp("made") / "trio.toml"
    file.write_text(content("usual"))
    store = open_store("memory://")
    surroundings = Environment(connect=lambda url: Client(url, working_service(store)))
    words = ["gate", str(file), "--planner-version", "v1", "--json"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("eigenfail.client.link.sleep", lambda seconds: None)
        run = CliRunner().invoke(app, words, obj=surroundings)
    assert run.exit_code == 0, run.output
    image = store.database._backend.image()
    store.close()
    return image, json.loads(run.stdout)


@pytest.fixture
def store(made):
    """A copy of that store, in place of an empty one: making a baseline takes seconds."""
    with closing(Store(Database(SqliteMemory(WAIT_S, made[0])))) as store:
        yield store


@pytest.fixture
def baseline(made):
    """What was said of the baseline."""
    return made[1]


@pytest.fixture
def gate(eigenfail, suite):
    """Gates a planner of this kind against v1."""

    def run(planner, *words, version="v2"):
        given = ("--planner-version", version, "--baseline", "v1")
        done = eigenfail("gate", suite(planner), *given, *words)
        assert done.exit_code in {0, 1}, done.output
        return done

    return run


@pytest.fixture
def parted(monkeypatch):
    """Failures of two campaigns together are as if each had failed in a mode of its own."""
    found = analysis_jobs.find_modes

    def apart(store, analysis):
        result = found(store, analysis)
        if not analysis.settings.campaigns:
            return result
        labels = tuple(int(each != analysis.campaign) for each in result.campaigns)
        modes = (result.modes * 2)[:2]
        texts = [text.split(": ", 1)[1] for text in (result.words * 2)[:2]]
        words = tuple(f"Mode {number}: {text}" for number, text in enumerate(texts, start=1))
        told = {"silhouette": 0.9, "noise_silhouette": 0.1, "stability": None}
        return replace(result, labels=labels, modes=modes, words=words, **told)

    monkeypatch.setattr(analysis_jobs, "find_modes", apart)
    monkeypatch.setattr("eigenfail.gate.known.NEW_MODE", 1.0)  # so few failures are chance
