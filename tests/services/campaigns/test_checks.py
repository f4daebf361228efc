"""What a campaign must be before it is taken on."""

import subprocess
import sys

import msgspec
import pytest

from eigenfail.errors import InputError, InvalidValue, UnknownName
from eigenfail.values import CampaignSpec, DisturbanceModel
from eigenfail_services.campaigns.checks import MAX_DEPTH, check_spec, horizon

GOOD = CampaignSpec(
    name="first", method="monte_carlo", episodes=10, planner="idm", simulator="point_mass"
)
NAN, INFINITY = float("nan"), float("inf")


def but(**changes):
    return msgspec.structs.replace(GOOD, **changes)


def test_a_good_spec_comes_back_as_it_was():
    assert check_spec(GOOD) is GOOD


def test_the_horizon_is_the_scenarios():
    assert horizon(GOOD) == 100


@pytest.mark.parametrize("method", ["monte_carlo", "ast", "difs", "cem", "replay"])
def test_every_method_is_known_with_its_defaults(method):
    assert check_spec(but(method=method)).method == method


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
        (but(episodes=-5), "episodes"),
        (but(episodes=10**12), "episodes"),
        (but(episodes=NAN), "episodes"),
        (but(seed=-1), "seed"),
        (but(price_usd_per_hour=NAN), "price_usd_per_hour"),
        (but(price_usd_per_hour=INFINITY), "price_usd_per_hour"),
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


def test_a_wrong_spec_has_no_horizon():
    with pytest.raises(InputError):
        horizon(but(scenario_parameters={"distance_m": 1e6}))


def test_checking_loads_nothing_heavy():
    code = (
        "import sys; from eigenfail.values import CampaignSpec\n"
        "from eigenfail_services.campaigns.checks import check_spec\n"
        "for method in ('monte_carlo', 'ast', 'difs', 'cem', 'replay'):\n"
        "    check_spec(CampaignSpec(name='n', method=method, episodes=1))\n"
        "heavy = {'torch', 'ray', 'stable_baselines3', 'sklearn', 'highway_env', 'sqlalchemy'}\n"
        "print(*heavy & sys.modules.keys())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.stdout.strip(), done.stderr) == ("", "")
