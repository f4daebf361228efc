"""The example scenario, as docs/own_scenario.md tells people to use it."""

import json
import re
import sys
from importlib import import_module
from itertools import product
from pathlib import Path

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace
from typer.testing import CliRunner

from eigenfail.cli.main import app
from eigenfail.cli.specs import check_plugins, read_spec
from eigenfail.errors import InputError
from eigenfail.testing.scenario import SCENARIO_CHECKS
from eigenfail.testing.simulation import SIMULATION_CHECKS
from eigenfail.values.disturbance import POSITION
from eigenfail.values.episode import EpisodeTask, PriorSource, TrajectorySource, episode_seed
from eigenfail_workers.engine import Engine
from eigenfail_workers.simulators.highway import HighwaySimulator

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "own_scenario.md").read_text()
PROJECT, CAMPAIGN = re.findall(r"^```toml\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
UNDISTURBED = EpisodeTask(0, 0, TrajectorySource(np.zeros((0, 2), np.float32)))
FEWER_LEVELS = {"spacing_m": (5.0,), "cars": (1, 3)}


@pytest.fixture
def mine(monkeypatch):
    """The module, imported as somebody does who works beside it."""
    monkeypatch.syspath_prepend(ROOT / "examples")
    monkeypatch.delitem(sys.modules, "my_scenario", raising=False)
    return import_module("my_scenario")


@pytest.fixture
def installed(install, mine):
    """The example as the page's pyproject.toml installs it."""
    install(PROJECT)


@pytest.fixture
def spec(installed, tmp_path):
    """The page's campaign, with a method that learns nothing."""
    file = tmp_path / "my_campaign.toml"
    file.write_text(CAMPAIGN)
    found = read_spec(file)
    check_plugins(found)
    return replace(found, method="monte_carlo")


def doctor(scenario):
    told = CliRunner().invoke(app, ["doctor", "--scenario", scenario, "--json"])
    return told.exit_code, json.loads(told.stdout)


@pytest.mark.parametrize("check", SIMULATION_CHECKS)
def test_it_makes_a_simulation_that_keeps_its_own(check, mine):
    scenario, parameters = mine.QueueEnd(), mine.QueueParameters()
    check(lambda planner: HighwaySimulator().open(scenario, parameters, planner, POSITION))


def test_the_doctor_finds_nothing_wrong_with_it(monkeypatch):
    monkeypatch.chdir(ROOT / "examples")
    code, checks = doctor("my_scenario:QueueEnd")
    assert code == 0
    assert [check["verdict"] for check in checks] == ["passed"] * (len(SCENARIO_CHECKS) + 1)
    rows = re.findall(r"^\| ([\w ]+) \| ", PAGE, re.MULTILINE)
    assert rows[1:] == [check["check"] for check in checks]


BROKEN = {
    "starts without overlap": ("last_x_m = parameters.gap_m", "last_x_m = 0.0", "the ego overlaps"),
    "has valid defaults": ("= 200.0", "= 20.0", "gap_m"),
    "has a steady horizon": ("steps=STEPS", "steps=STEPS + seed % 3", "vary with the seed"),
    "moves actors as they say": ("x_m=start.x_m + way_m", "x_m=start.x_m + 9 * way_m", "jumps to"),
    "is plausible": ("parameters.queue_speed_mps, *C", "float('nan'), *C", "finite numbers"),
    "repeats itself": ("last_x_m + n", "last_x_m + next(ODDS) + n", "gave two situations"),
}


@pytest.mark.parametrize("check", BROKEN)
def test_the_doctor_says_what_is_wrong_with_a_broken_one(check, tmp_path, monkeypatch):
    right, wrong, words = BROKEN[check]
    text = (ROOT / "examples" / "my_scenario.py").read_text()
    assert right in text
    odds = "\nfrom itertools import count\nODDS = count()\n"
    name = "broken_" + check.replace(" ", "_")
    (tmp_path / f"{name}.py").write_text(text.replace(right, wrong) + odds)
    monkeypatch.chdir(tmp_path)
    code, checks = doctor(f"{name}:QueueEnd")
    said = {one["check"]: one["said"] for one in checks if one["verdict"] == "broken"}
    assert code == 1
    assert words in said[check]


def test_it_runs_the_campaign_of_the_page(spec):
    tasks = [EpisodeTask(i, episode_seed(1, i), PriorSource()) for i in range(4)]
    results = list(Engine(spec.setup()).run([UNDISTURBED, *tasks]))
    assert [result.fault for result in results] == [None] * 5
    assert {result.steps for result in results} == {200}
    assert results[0].outcome == "safe"
    assert results[0].scene.vehicles.shape[1] == 1 + spec.scenario_parameters["cars"]


@pytest.mark.parametrize("planner", ["rulebook", "idm"])
def test_undisturbed_it_is_safe_everywhere_in_its_bounds(planner, spec, mine):
    grid = levels(mine.QueueParameters) | FEWER_LEVELS
    for values in product(*grid.values()):
        parameters = dict(zip(grid, values, strict=True))
        varied = replace(spec, planner=planner, scenario_parameters=parameters)
        (result,) = Engine(replace(varied, simulator="point_mass").setup()).run([UNDISTURBED])
        assert result.outcome == "safe", parameters
        assert result.measures.robustness_m > 1.0, parameters
        assert result.scene.vehicles[-1, 0, 3] > 1.0, parameters


def levels(kind):
    """Smallest, default and largest value of each parameter."""
    (schema,) = msgspec.json.schema(kind)["$defs"].values()
    return {
        name: (field["minimum"], field["default"], field["maximum"])
        for name, field in schema["properties"].items()
    }


def test_the_truck_has_to_do_something_about_it(spec):
    (result,) = Engine(spec.setup()).run([UNDISTURBED])
    assert result.scene.controls[:, 0].min() < -0.5
    assert result.scene.vehicles[-1, 0, 3] < 0.5 * result.scene.vehicles[0, 0, 3]


@pytest.mark.parametrize("wrong", [{"gap_m": 20.0}, {"cars": 2.5}, {"colour": 1}])
def test_its_parameters_are_bounded(wrong, spec):
    with pytest.raises(InputError, match=next(iter(wrong))):
        Engine(replace(spec, scenario_parameters=wrong).setup())
