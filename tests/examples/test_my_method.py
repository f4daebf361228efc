"""The example method, as docs/own_method.md tells people to use it."""

import json
import random
import re
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from eigenfail.cli.main import app
from eigenfail.cli.plugin_checks import METHOD_CHECKS
from eigenfail.cli.specs import check_plugins, read_spec
from eigenfail.testing.learner import CORRIDOR, LearnerSuite, ToyEngine
from eigenfail_services.campaigns.rounds import Rounds, run_in_process

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "own_method.md").read_text()
CHECKS = re.search(r"^\| check \|.*\n\|[-|]+\n((?:\|.*\n)+)", PAGE, re.MULTILINE).group(1)
PROJECT, CAMPAIGN = re.findall(r"^```toml\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


@pytest.fixture
def mine(monkeypatch):
    """The module, imported as somebody does who works beside it."""
    monkeypatch.syspath_prepend(ROOT / "examples")
    monkeypatch.chdir(ROOT / "examples")
    monkeypatch.delitem(sys.modules, "my_method", raising=False)
    return import_module("my_method")


def doctor(method):
    told = CliRunner().invoke(app, ["doctor", "--method", method, "--json"])
    checks = json.loads(told.stdout) if told.stdout else []
    return told.exit_code, {check["check"]: check["verdict"] for check in checks}


def test_the_doctor_finds_nothing_wrong_with_it(mine):
    code, checks = doctor("my_method:HillClimb")
    assert code == 0
    assert set(checks.values()) == {"passed"}
    assert list(checks) == re.findall(r"^\| ([\w ]+) \| ", CHECKS, re.MULTILINE)
    assert len(checks) == len(METHOD_CHECKS) + 1


@pytest.mark.parametrize(
    ("attribute", "change", "broken"),
    [
        ("lookahead", -1, "looks ahead by a whole number of rounds"),
        ("restore", lambda self, state: None, "refuses garbage as a state and stays as it was"),
        ("state", lambda self: b"", "restored learner goes on bit for bit"),
    ],
)
def test_the_doctor_names_what_is_broken(mine, monkeypatch, attribute, change, broken):
    monkeypatch.setattr(mine.HillClimb, attribute, change)
    code, checks = doctor("my_method:HillClimb")
    assert (code, checks[broken]) == (1, "broken")


@pytest.mark.parametrize("generator", [random, np.random])
def test_the_doctor_sees_a_global_generator_that_is_seeded_each_time(mine, monkeypatch, generator):
    propose = mine.HillClimb.propose

    def draw_and_propose(self, n):
        generator.seed(self._facts.rounds)
        generator.uniform(0.0, 1.0)
        return propose(self, n)

    monkeypatch.setattr(mine.HillClimb, "propose", draw_and_propose)
    for _ in range(2):  # the first run leaves the state that a second one comes to
        code, checks = doctor("my_method:HillClimb")
        assert (code, checks["leaves the global generators alone"]) == (1, "broken")


def test_it_is_accepted_in_the_campaign_of_the_page(mine, install, tmp_path):
    install(PROJECT)
    file = tmp_path / "my_campaign.toml"
    file.write_text(CAMPAIGN)
    spec = read_spec(file)
    check_plugins(spec)
    assert (spec.method, spec.settings) == ("hill_climb", {"step": 0.5})


def test_it_comes_nearer_from_round_to_round(mine):
    class Forgetful(mine.HillClimb):
        def observe(self, results):
            """Learn nothing."""

    found = []
    for method in (mine.HillClimb, Forgetful):
        suite = type("Suite", (LearnerSuite,), {"method": method, "budget": 400})()
        results = run_in_process(Rounds(suite.learner(3), 3, 400), ToyEngine(CORRIDOR))
        found.append([result.is_failure for result in results])
    learnt, forgot = (sum(failures[200:]) for failures in found)
    assert learnt > 1.5 * forgot > 0
