"""The example planner, as docs/own_planner.md tells people to use it."""

import json
import re
from pathlib import Path

import msgspec
import numpy as np
import pytest
from typer.testing import CliRunner

from eigenfail.cli.main import app
from eigenfail.cli.specs import check_plugins, read_spec
from eigenfail.errors import InvalidValue
from eigenfail.testing.planner import PLANNER_CHECKS
from eigenfail.values.episode import EpisodeTask, PriorSource, TrajectorySource, episode_seed
from eigenfail_workers.engine import Engine
from eigenfail_workers.explain import explain

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "own_planner.md").read_text()
CHECKS = re.search(r"^\| check \|.*\n\|[-|]+\n((?:\|.*\n)+)", PAGE, re.MULTILINE).group(1)
PROJECT, CAMPAIGN = re.findall(r"^```toml\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
UNDISTURBED = TrajectorySource(np.zeros((0, 2), np.float32))


@pytest.fixture
def installed(install):
    """The example as the page's pyproject.toml installs it."""
    install(PROJECT)


@pytest.fixture
def spec(installed, tmp_path):
    """The page's campaign, on the simulator that takes no time."""
    file = tmp_path / "my_campaign.toml"
    file.write_text(CAMPAIGN)
    found = read_spec(file)
    check_plugins(found)
    return msgspec.structs.replace(found, simulator="point_mass", method="monte_carlo")


def test_the_doctor_finds_nothing_wrong_with_it(monkeypatch):
    monkeypatch.chdir(ROOT / "examples")
    told = CliRunner().invoke(app, ["doctor", "--planner", "my_planner:MyPlanner", "--json"])
    assert told.exit_code == 0, told.output
    checks = json.loads(told.stdout)
    assert [check["verdict"] for check in checks] == ["passed"] * (len(PLANNER_CHECKS) + 1)
    rows = re.findall(r"^\| ([\w ]+) \| ", CHECKS, re.MULTILINE)
    assert rows == [check["check"] for check in checks]


def test_it_drives_the_campaign_of_the_page(spec):
    assert (spec.planner, spec.planner_settings) == ("my_planner", {"time_gap_s": 2.5})
    tasks = [EpisodeTask(0, 0, UNDISTURBED)]
    tasks += [EpisodeTask(i, episode_seed(1, i), PriorSource()) for i in range(1, 6)]
    results = list(Engine(spec.setup()).run(tasks))
    assert [result.fault for result in results] == [None] * 6
    assert results[0].outcome == "safe"
    assert results[0].measures.robustness_m > 5.0


def test_its_settings_matter_and_are_bounded(spec):
    def nearest(time_gap_s):
        settings = {"time_gap_s": time_gap_s}
        other = msgspec.structs.replace(spec, planner_settings=settings)
        (result,) = Engine(other.setup()).run([EpisodeTask(0, 0, UNDISTURBED)])
        return result.measures.robustness_m

    assert nearest(0.5) < nearest(1.5) < nearest(4.0)
    with pytest.raises(InvalidValue, match="time_gap_s"):
        nearest(0.1)


def test_it_explains_itself(spec):
    explained = explain(spec.setup(), EpisodeTask(0, 0, UNDISTURBED))
    heeded = [step.account["heeds"] for step in explained.steps]
    assert heeded[0] == "nobody"
    assert heeded[-1] == "lead"
