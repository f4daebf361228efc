"""What a campaign may not say is refused in words, before anything of it is imported."""

import sys

import pytest
from approach_environment import ID, MODULE

from eigenfail import plugins
from eigenfail.errors import InputError, InvalidValue, PlannerError, UnknownName
from eigenfail.settings import read_settings
from eigenfail.testing.simulation import Cruise
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.channels import Channel
from eigenfail.values.scene import Perception, VehicleState
from eigenfail_gymnasium.environments import GymnasiumParameters
from eigenfail_gymnasium.policies import PolicyPlanner, PolicySettings
from eigenfail_gymnasium.scenario import GymnasiumScenario
from eigenfail_gymnasium.simulator import GymnasiumSimulator
from eigenfail_services.campaigns.validation import check_spec


def make_spec(**changes):
    given = {
        "name": "refused",
        "method": "monte_carlo",
        "episodes": 10,
        "simulator": "gymnasium",
        "scenario": "gymnasium",
        "planner": "policy",
        "scenario_parameters": {"env": "merge-v0", "steps": 4},
    }
    return CampaignSpec(**(given | changes))


def test_the_three_plug_ins_are_found_and_a_campaign_of_them_is_taken():
    assert plugins.load(plugins.SIMULATORS, "gymnasium") is GymnasiumSimulator
    assert plugins.load(plugins.SCENARIOS, "gymnasium") is GymnasiumScenario
    assert plugins.load(plugins.PLANNERS, "policy") is PolicyPlanner
    assert check_spec(make_spec()).form.steps == 4


REFUSED = {
    "another id": ({"env": "merge-v99", "steps": 4}, UnknownName, "'merge-v99' is not known"),
    "a module in the id": ({"env": "os:merge-v0"}, UnknownName, "is not known"),
    "no horizon": ({"env": "merge-v0"}, InvalidValue, "Write steps = 20"),
    "a package": ({"env": "x-v0", "package": "antigravity"}, InvalidValue, "not in the list"),
    "a key": ({"env": "highway-v0", "config": {"lanes": 3}}, UnknownName, "'lanes' is not known"),
    "a class": (
        {"env": "highway-v0", "config": {"other_vehicles_type": "antigravity.Car"}},
        InvalidValue,
        "'antigravity' is not in the list",
    ),
    "an observation": (
        {"env": "highway-v0", "config": {"observation": {"type": "Nothing"}}},
        InvalidValue,
        "cannot be made",
    ),
    "a screen": ({"env": ID, "arguments": {"render_mode": "human"}}, InvalidValue, "no screen"),
    "an argument": ({"env": ID, "arguments": {"wings": 2}}, InvalidValue, "cannot be made"),
    "a margin": ({"env": ID, "margin": "os:remove"}, InvalidValue, "'os' is not in the list"),
    "no place": ({"env": ID, "margin": "remove"}, InvalidValue, "not of the form"),
    "two answers": (
        {"env": ID, "margin": f"{MODULE}:distance", "failure_key": "hit"},
        InvalidValue,
        "two answers",
    ),
    "config elsewhere": ({"env": ID, "config": {"a": 1}}, InvalidValue, "not of highway-env"),
    "a margin of a road": (
        {"env": "merge-v0", "steps": 4, "failure_key": "crashed"},
        InvalidValue,
        "fail by collisions",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_parameters_are_refused_at_the_launch(name):
    parameters, kind, words = REFUSED[name]
    with pytest.raises(InputError, match=words) as refusal:
        check_spec(make_spec(scenario_parameters=parameters))
    assert isinstance(refusal.value, kind)
    assert refusal.value.field.startswith("scenario_parameters")
    assert "antigravity" not in sys.modules


SETTINGS = {
    "a module": ({"function": "os:remove"}, "'os' is not in the list"),
    "no place": ({"function": "brake"}, "not of the form"),
    "an algorithm": ({"model": "a.zip", "algorithm": "DQM"}, "'DQM' is not known. .*DQN"),
    "another folder": ({"model": "../a.zip", "algorithm": "DQN"}, "not below the folder"),
    "the root": ({"model": "/a.zip", "algorithm": "DQN"}, "not below the folder"),
    "two policies": ({"model": "a.zip", "function": f"{MODULE}:brake"}, "two policies"),
}


@pytest.mark.parametrize("name", SETTINGS)
def test_settings_are_refused_at_the_launch(name):
    settings, words = SETTINGS[name]
    with pytest.raises(InputError, match=words) as refusal:
        check_spec(make_spec(planner_settings=settings))
    assert refusal.value.field.startswith("planner_settings")


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"function": f"{MODULE}:undeclared"}, "not declared to be a policy"),
        ({"function": f"{MODULE}:distance"}, "not declared to be a policy"),
        ({"function": f"{MODULE}:absent"}, "not declared to be a policy"),
        ({"model": "absent.zip", "algorithm": "DQN"}, "there is no file 'absent.zip'"),
        ({"model": f"{MODULE}.py", "algorithm": "DQN"}, "is no DQN for this environment"),
    ],
)
def test_policies_that_are_not_there_are_refused_by_the_worker(settings, words):
    planner = PolicyPlanner(read_settings(PolicySettings, settings, "planner_settings"))
    parameters = GymnasiumParameters(env=ID)
    channels = (Channel("observation.0").filled(),)
    simulation = GymnasiumSimulator().open(GymnasiumScenario(), parameters, planner, channels)
    simulation.reset(0)
    with pytest.raises(InvalidValue, match=words):
        simulation.step((0.0,))


def test_a_number_that_the_observation_lacks_is_refused():
    channels = (Channel("observation.2").filled(),)
    with pytest.raises(UnknownName, match=r"observation\.0, observation\.1"):
        GymnasiumSimulator().open(
            GymnasiumScenario(), GymnasiumParameters(env=ID), Cruise(), channels
        )


def test_other_scenarios_simulators_and_planners_are_kept_apart():
    with pytest.raises(InvalidValue, match='scenario = "gymnasium"'):
        GymnasiumSimulator().open(GymnasiumScenario(), object(), Cruise(), ())
    car = VehicleState(0.0, 0.0, 0.0, 0.0, 5.0, 2.0)
    with pytest.raises(PlannerError, match='simulator = "gymnasium"'):
        PolicyPlanner(PolicySettings()).act(Perception(0.0, car, (car,), (1,)))
