"""The example simulator, held against its contract, and as docs/own_simulator.md registers it."""

import re
import sys
import tomllib
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from eigenfail import plugins
from eigenfail.cli.specs import read_spec
from eigenfail.testing.simulation import SIMULATION_CHECKS
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.disturbance import POSITION
from eigenfail.values.episode import EpisodeTask, Outcome, TrajectorySource
from eigenfail_workers.engines import make_engine
from eigenfail_workers.planners.idm import IntelligentDriver
from eigenfail_workers.scenarios.cut_in import CutIn

EXAMPLES = Path(__file__).parents[2] / "examples"
PAGE = (EXAMPLES.parent / "docs" / "own_simulator.md").read_text()


@pytest.fixture
def simulator(monkeypatch):
    monkeypatch.setattr(sys, "path", [*sys.path, str(EXAMPLES)])
    return import_module("my_simulator").LaggingBrakes()


@pytest.mark.parametrize("check", SIMULATION_CHECKS, ids=lambda check: check.__name__)
def test_it_keeps_to_its_contract(simulator, check):
    check(lambda planner: simulator.open(CutIn(), CutIn.Parameters(), planner, POSITION))


def test_its_brakes_take_a_moment(simulator):
    planner = IntelligentDriver(IntelligentDriver.Settings())
    simulation = simulator.open(CutIn(), CutIn.Parameters(), planner, POSITION)
    seen = [simulation.reset(0)]
    while not seen[-1].ended:
        seen.append(simulation.step((0.0, 0.0)))
    told = [each for each in seen[1:] if each.control.acceleration_mps2 < -2.0]
    assert told
    assert told[0].applied.acceleration_mps2 > told[0].control.acceleration_mps2 + 0.5
    assert not seen[-1].collided


def test_a_campaign_can_name_it(simulator, monkeypatch):
    load = plugins.load
    here = {(plugins.SIMULATORS, "lagging_brakes"): type(simulator)}
    monkeypatch.setattr(plugins, "load", lambda *named: here.get(named) or load(*named))
    spec = CampaignSpec(
        name="n", method="monte_carlo", episodes=1, planner="idm", simulator="lagging_brakes"
    )
    task = EpisodeTask(0, 0, TrajectorySource(np.zeros((100, 2), np.float32)))
    (result,) = make_engine(spec.setup()).run([task])
    assert result.outcome is Outcome.SAFE


def test_the_page_registers_it_and_names_it(tmp_path):
    project, campaign = re.findall(r"^```toml\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    registered = tomllib.loads(project)["project"]["entry-points"]["eigenfail.simulators"]
    assert registered == {"lagging_brakes": "my_simulator:LaggingBrakes"}
    file = tmp_path / "campaign.toml"
    file.write_text(campaign)
    assert read_spec(file).simulator == "lagging_brakes"


def test_the_test_of_the_page_passes(tmp_path, monkeypatch, simulator):
    (code,) = (
        block
        for block in re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
        if "SIMULATION_CHECKS" in block
    )
    told = {}
    exec(compile(code, "own_simulator.md", "exec"), told)
    for check in SIMULATION_CHECKS:
        told["test_my_simulator"](check)
