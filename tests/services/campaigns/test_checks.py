"""What a campaign must be before it is taken on."""

import subprocess
import sys

import msgspec
import pytest
from resolved import resolve_campaign

from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.settings import MAX_DEPTH
from eigenfail.values.campaign_spec import CampaignSpec, StopRules
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail_services.campaigns.validation import check_spec, fill_defaults

GOOD = CampaignSpec(
    name="first", method="monte_carlo", episodes=10, planner="idm", simulator="point_mass"
)
NAN, INFINITY = float("nan"), float("inf")


def but(**changes):
    return msgspec.structs.replace(GOOD, **changes)


def test_a_good_spec_comes_back_as_it_was():
    assert check_spec(GOOD).spec == GOOD


@pytest.mark.parametrize(
    ("spec", "field", "known"),
    [
        (but(method="monte_karlo"), "method", "monte_carlo"),
        (but(planner="rulebok"), "planner", "rulebook"),
        (but(scenario="cutin"), "scenario", "cut_in"),
        (but(simulator="highwy"), "simulator", "highway"),
        (but(settings={"rounds": 1}), "settings", "round_size"),
        (but(planner_settings={"headway": 1}), "planner_settings", "time_headway_s"),
        (but(scenario_parameters={"distance": 1}), "scenario_parameters", "distance_m"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_unknown_names_are_refused_with_the_known_ones(spec, field, known):
    with pytest.raises(UnknownName) as refusal:
        check_spec(spec)
    assert refusal.value.field == field
    assert known in refusal.value.known


@pytest.mark.parametrize(
    ("spec", "field"),
    [
        (but(episodes=0), "episodes"),
        (but(episodes=10**12), "episodes"),
        (but(episodes=NAN), "episodes"),
        (but(seed=-1), "seed"),
        (but(price_usd_per_hour=NAN), "price_usd_per_hour"),
        (but(disturbance=DisturbanceModel(lateral_slope=NAN)), "disturbance.lateral_slope"),
        (but(disturbance=DisturbanceModel(lateral_base_m=0.0)), "disturbance.lateral_base_m"),
        (but(settings={"round_size": -INFINITY}), "settings.round_size"),
        (but(settings={"round_size": 0}), "settings.round_size"),
        (but(settings={"round_size": 2**64}), "settings.round_size"),
        (but(planner_settings={"time_headway_s": NAN}), "planner_settings.time_headway_s"),
        (but(scenario_parameters={"distance_m": NAN}), "scenario_parameters.distance_m"),
        (but(scenario_parameters={"distance_m": [0.0, NAN]}), "scenario_parameters.distance_m.1"),
        (but(scenario_parameters={"distance_m": 1e6}), "scenario_parameters.distance_m"),
        (but(name="bell\x07"), "name"),
        (but(name="half\ud800"), "name"),
        (but(settings={"nul\x00": 1}), "settings.(name)"),
        (but(stop=StopRules(failures=0)), "stop.failures"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_values_outside_their_bounds_are_refused_by_their_path(spec, field):
    with pytest.raises(InvalidValue) as refusal:
        check_spec(spec)
    assert refusal.value.field == field


def test_nesting_has_an_end():
    nested: dict[str, object] = {}
    for _ in range(100_000):
        nested = {"a": nested}
    with pytest.raises(InvalidValue, match=f"more than {MAX_DEPTH} levels"):
        check_spec(but(settings=nested))


def test_checking_loads_nothing_heavy():
    code = (
        "import sys; from eigenfail.values.campaign_spec import CampaignSpec\n"
        "from eigenfail_services.campaigns.validation import check_spec\n"
        "for method in ('monte_carlo', 'ast', 'difs', 'cem', 'replay', 'subset'):\n"
        "    check_spec(CampaignSpec(name='n', method=method, episodes=500))\n"
        "heavy = {'torch', 'ray', 'stable_baselines3', 'sklearn', 'highway_env', 'sqlalchemy'}\n"
        "print(*heavy & sys.modules.keys())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.stdout.strip(), done.stderr) == ("", "")


def test_a_rule_on_an_estimate_needs_a_method_that_makes_one():
    with pytest.raises(InvalidValue, match=r"stop\.cv: replay estimates no probability\."):
        check_spec(but(method="replay", stop=StopRules(cv=0.1)))


def test_a_rule_on_an_estimate_needs_settings_under_which_there_is_one():
    given = StopRules(cv=0.1)
    members = {"method": "ast", "members": 2, "settings": {"hold": 5}}
    with pytest.raises(InvalidValue, match=r"stop\.cv: ast estimates .* held for 10 .* hold = 1"):
        check_spec(but(method="ast", stop=given))
    with pytest.raises(InvalidValue, match=r"held for 5 steps has no density under p\(z\)"):
        check_spec(but(method="ensemble", settings=members, stop=given))
    spec = but(method="ast", settings={"hold": 1}, stop=given)
    assert check_spec(spec).spec == spec


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"method": "subset", "episodes": 100}, r"episodes: 100 are fewer than .* Give more"),
        (
            {"method": "ensemble", "episodes": 300, "settings": {"method": "subset"}},
            r"episodes: 75 are fewer than",
        ),
        (
            {"method": "ensemble", "episodes": 3, "settings": {"members": 4}},
            r"4 members cannot share 3 episodes\. Ask for fewer members",
        ),
    ],
)
def test_a_budget_that_a_method_cannot_begin_with_is_refused(changes, words):
    with pytest.raises(InvalidValue, match=words):
        check_spec(but(**changes))


VARIED = {"distance_m": {"uniform": [52, 70]}, "actor_speed_mps": {"choice": [12.0, 16.0]}}


def test_the_horizon_of_a_distribution_is_that_of_its_longest():
    assert check_spec(but(scenario_parameters=VARIED)).spec.scenario_parameters == VARIED
    slowest = {"distance_m": 52.0, "actor_speed_mps": 16.0}
    longest = resolve_campaign(but(scenario_parameters=slowest)).form.steps
    assert (
        resolve_campaign(but(scenario_parameters=VARIED)).form.steps
        == longest
        > resolve_campaign(GOOD).form.steps
    )


@pytest.mark.parametrize("ends", [[51, 60], [52, 71]])
def test_both_ends_of_a_distribution_have_to_be_within_bounds(ends):
    with pytest.raises(InvalidValue) as refusal:
        check_spec(but(scenario_parameters={"distance_m": {"uniform": ends}}))
    assert refusal.value.field == "scenario_parameters.distance_m"
    assert "is not a number" in str(refusal.value)


def test_a_function_is_listed_to_be_launched_but_not_to_be_read(monkeypatch):
    spec = but(
        simulator="function",
        scenario="function",
        planner="m:f",
        planner_settings={},
        scenario_parameters={"steps": 7},
    )
    monkeypatch.delenv("EIGENFAIL_FUNCTIONS")
    with pytest.raises(InvalidValue, match="eigenfail up --functions m"):
        check_spec(spec)
    assert (
        resolve_campaign(spec).form.steps == fill_defaults(spec).scenario_parameters["steps"] == 7
    )


SPLITTING = {"method": "splitting", "episodes": 4000}


def test_splitting_takes_a_scenario_with_fixed_parameters():
    spec = but(**SPLITTING, scenario_parameters={"distance_m": 55.0})
    assert check_spec(spec).spec == spec


def test_what_continues_episodes_is_refused_where_parameters_are_drawn():
    with pytest.raises(InvalidValue, match="distance_m, actor_speed_mps drawn") as refusal:
        check_spec(but(**SPLITTING, scenario_parameters=VARIED))
    assert refusal.value.field == "scenario_parameters"


def test_what_continues_episodes_is_refused_for_functions(monkeypatch):
    monkeypatch.setenv("EIGENFAIL_FUNCTIONS", "m")
    function = {"simulator": "function", "scenario": "function", "planner": "m:f"}
    spec = but(**SPLITTING, **function, planner_settings={}, scenario_parameters={"steps": 7})
    with pytest.raises(InvalidValue, match="functions have no steps"):
        check_spec(spec)
