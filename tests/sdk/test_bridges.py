"""Campaigns on a bridge: what they may ask for, and where a bridge may be."""

import pytest
from msgspec.structs import replace

from eigenfail import bridges
from eigenfail.cli.gate import list_packages
from eigenfail.cli.specs import check_plugins
from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.channels import Channel
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.requirements import Formula
from eigenfail.wire.http import make_error, make_problem
from eigenfail.worlds import drawn_for, list_simulators, world_of


def spec(**parameters) -> CampaignSpec:
    return CampaignSpec(
        name="t",
        method="monte_carlo",
        episodes=9,
        simulator="bridge",
        scenario="crossing, wet",
        planner="theirs 2.1",
        planner_settings={"speed": 9.5, "bold": True, "map": "a"},
        scenario_parameters=parameters,
    )


def test_any_name_and_any_plain_parameter_will_do() -> None:
    asked = spec(steps=80, gap_m=12.5, wet=False, kind="van")
    check_plugins(asked)
    form = world_of("bridge").find_form(asked)
    assert (form.steps, form.step_s) == (80, 0.1)
    (parameters,) = bridges.check(asked).corners()
    told = bridges.select_bridge_parameters(parameters)
    assert told == {"gap_m": 12.5, "wet": False, "kind": "van"}


def test_a_parameter_may_vary_as_any_scenarios() -> None:
    asked = spec(steps=80, gap_m={"uniform": [10.0, 14.0]}, kind={"choice": ["van", "car"]})
    drawn = [drawn_for(asked, seed) for seed in range(50)]
    assert {each["kind"] for each in drawn} == {"van", "car"}
    assert all(10.0 <= each["gap_m"] <= 14.0 for each in drawn)
    assert world_of(asked.simulator).variation(asked).drawn(3) == drawn[3]


def test_the_longest_episode_is_the_horizon() -> None:
    asked = spec(steps={"choice": [50, 70, 60]}, dt_s=0.05)
    assert world_of("bridge").find_form(asked).steps == 70


@pytest.mark.parametrize("varied", [{"choice": [0.05, 0.1]}, {"uniform": [0.05, 0.1]}])
def test_a_campaign_has_one_duration_of_a_step(varied: dict[str, list[float]]) -> None:
    with pytest.raises(InvalidValue, match="duration of a step varies"):
        world_of("bridge").find_form(spec(steps=9, dt_s=varied))
    assert world_of("bridge").find_form(spec(steps=9, dt_s={"choice": [0.05]})).step_s == 0.05


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({}, "scenario_parameters.steps: is missing."),
        ({"steps": 0}, "scenario_parameters.steps: 0 is not an integer from 1 to"),
        ({"steps": 2.5}, "scenario_parameters.steps: 2.5 is not an integer"),
        ({"steps": 9, "dt_s": 0.0}, "scenario_parameters.dt_s: 0.0 is not a number above 0"),
        ({"steps": 9, "gap_m": float("nan")}, "scenario_parameters.gap_m: is not a finite number"),
        (
            {"steps": 9, "gap_m": [1.0]},
            "scenario_parameters.gap_m: .* is not true or false, an integer",
        ),
        (
            {"steps": 9, "gap_m": None},
            "scenario_parameters.gap_m: .* is not true or false, an integer",
        ),
        ({"steps": 9, "kind": "v" * 201}, "scenario_parameters.kind: is not a finite number"),
        ({"steps": 9, "gap m": 1.0}, "scenario_parameters.gap m: is not a valid parameter name."),
        ({"steps": 9, "gap_m": {"uniform": [2.0, 1.0]}}, "gap_m.uniform: .* is not an interval"),
        ({"steps": 9} | {f"p{n}": 1.0 for n in range(64)}, "scenario_parameters: there are 65."),
    ],
)
def test_what_no_bridge_can_be_told_is_refused(parameters, said: str) -> None:
    with pytest.raises((InvalidValue, UnknownName), match=said):
        bridges.check(spec(**parameters))


def test_settings_of_the_planner_are_plain_too() -> None:
    with pytest.raises(InvalidValue, match=r"planner_settings\.speed: is not a finite number"):
        bridges.read_plain({"speed": ("a",)}, "planner_settings")


def test_a_foreign_planner_has_no_code_here() -> None:
    assert list(list_packages(spec(steps=9))) == []


def test_the_bridge_is_a_simulator_that_campaigns_may_name() -> None:
    assert {"bridge", "function", "highway"} <= set(list_simulators())


@pytest.mark.parametrize(
    "address",
    ["tcp://127.0.0.1:9000", "tcp://localhost:1", "tcp://[::1]:65535", "ipc:///tmp/a.bridge"],
)
def test_a_bridge_on_this_machine_needs_no_trust(address: str, monkeypatch) -> None:
    monkeypatch.delenv("EIGENFAIL_TRUST_NETWORK", raising=False)
    assert bridges.check_address(address) == address


@pytest.mark.parametrize(
    "address",
    [
        "tcp://10.0.0.7:9000",
        "tcp://127.example.org:9000",
        "tcp://localhost.example.org:9000",
        "tcp://[2001:db8::1]:9000",
    ],
)
def test_a_bridge_elsewhere_is_a_decision(address: str, monkeypatch) -> None:
    monkeypatch.delenv("EIGENFAIL_TRUST_NETWORK", raising=False)
    with pytest.raises(InvalidValue, match="EIGENFAIL_TRUST_NETWORK=1"):
        bridges.check_address(address)
    monkeypatch.setenv("EIGENFAIL_TRUST_NETWORK", "1")
    assert bridges.check_address(address) == address


@pytest.mark.parametrize(
    "address", ["", "9000", "tcp://127.0.0.1", "tcp://*:1", "inproc://a", "ipc://"]
)
def test_what_is_no_address_is_refused(address: str) -> None:
    with pytest.raises(InvalidValue, match="is not a valid bridge address"):
        bridges.check_address(address)


OFFER = bridges.BridgeOffer(
    "theirs",
    "2.1",
    (bridges.OfferedScenario("crossing, wet", 0.1, 80, ("gap_m", "wet")),),
    (bridges.OfferedPlanner("theirs 2.1", ("speed", "bold", "map")),),
    ("longitudinal", "lateral", "every.speed", "ego.heading"),
    ("planned_gap_m",),
)


def check_offer(asked: CampaignSpec) -> None:
    world = world_of(asked.simulator)
    resolved = replace(asked, disturbance=world.resolve_disturbance(asked))
    world.check_offer(resolved, OFFER)


def disturb(*names: str) -> DisturbanceModel:
    return DisturbanceModel(channels=tuple(map(Channel, names)))


FITTING = spec(steps=80, gap_m={"uniform": [8.0, 9.0]})


def test_a_campaign_that_fits_the_offer_is_let_through() -> None:
    check_offer(FITTING)
    channels = disturb("vehicle_7.speed", "ego.heading", "scenario.gap_m")
    formula = Formula(formula="always (bridge.planned_gap_m > 0 and speed_mps > 0)")
    check_offer(replace(FITTING, disturbance=channels, requirements=(formula,), importance=formula))


MISFITS = {
    "scenario": (
        {"scenario": "crossing"},
        "the bridge 'theirs' (version 2.1). Did you mean 'crossing, wet'?",
    ),
    "planner": ({"planner": "theirs 2.0"}, "Did you mean 'theirs 2.1'?"),
    "planner_settings": ({"planner_settings": {"sped": 9.5}}, "Did you mean 'speed'?"),
    "scenario_parameters": (
        {"scenario_parameters": {"steps": 80, "gap": {"uniform": [8.0, 9.0]}}},
        "Did you mean 'gap_m'?",
    ),
    "scenario_parameters.steps": (
        {"scenario_parameters": {"steps": {"choice": [70, 81]}}},
        "'crossing, wet' of the bridge 'theirs' (version 2.1) has no more than 80 steps",
    ),
    "scenario_parameters.dt_s": (
        {"scenario_parameters": {"steps": 80, "dt_s": 0.05}},
        "Write dt_s = 0.1",
    ),
    "disturbance.channels": ({"disturbance": disturb("lateral", "ego.speed")}, "Known: "),
    "requirements[0]": (
        {"requirements": (Formula(formula="always (bridge.planned_gap > 0)"),)},
        "Did you mean 'bridge.planned_gap_m'?",
    ),
    "importance": ({"importance": Formula(formula="always (bridge.gap > 0)")}, "Known: "),
}


@pytest.mark.parametrize("field", MISFITS)
def test_what_the_bridge_does_not_offer_is_refused_with_its_field(field) -> None:
    changes, said = MISFITS[field]
    with pytest.raises((UnknownName, InvalidValue)) as refused:
        check_offer(replace(FITTING, **changes))
    assert refused.value.field == field
    assert said in str(refused.value)
    assert "the bridge 'theirs' (version 2.1)" in refused.value.problem
    arrived = make_error(make_problem(refused.value))
    assert (type(arrived), str(arrived)) == (type(refused.value), str(refused.value))


def test_a_bridge_that_offers_none_says_so() -> None:
    with pytest.raises(UnknownName, match="There are none"):
        bridges.check_signals(replace(OFFER, signals=()), ["bridge.gap_m"])
