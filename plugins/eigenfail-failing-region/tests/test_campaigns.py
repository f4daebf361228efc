"""The failing region of campaigns: parameters come from seeds and specs."""

import pytest
from msgspec.structs import replace
from store_checks.examples import deliver, running

from eigenfail import plugins
from eigenfail.errors import InvalidValue, NotFound
from eigenfail.testing.examples import collision, result
from eigenfail.values.episode import episode_seed
from eigenfail.values.variation import read_variation
from eigenfail_failing_region.campaigns import find_region, make_columns

VARIED = {"distance_m": {"uniform": [52.0, 70.0]}, "ego_speed_mps": {"choice": [22.0, 25.0]}}
EPISODES = 300


def run(store, fails, **changes) -> int:
    """A campaign that fails where its drawn parameters say so."""
    fields = {"episodes": EPISODES, "scenario": "cut_in"} | changes
    campaign = running(store, **fields)
    kind = plugins.load(plugins.SCENARIOS, "cut_in").Parameters
    variation = read_variation(kind, campaign.spec.scenario_parameters)
    for index in range(campaign.spec.episodes):
        seed = episode_seed(campaign.spec.seed, index)
        made = collision(index) if fails(variation.draw(seed), index) else result(index)
        deliver(store, campaign, replace(made, seed=seed, scene=None))
    return campaign.id


def test_parameters_are_those_that_each_episode_drew(store) -> None:
    campaign = run(store, lambda p, _: p.distance_m < 58.0, scenario_parameters=VARIED)
    found = find_region(store, [campaign])
    assert found.parameters == ("distance_m", "ego_speed_mps")
    assert (found.scenario, found.episodes) == ("cut_in", EPISODES)
    (box,) = found.boxes
    assert box.words.startswith("distance at most 5")
    assert box.bounds[0].high == pytest.approx(58.0, abs=0.5)
    assert found.warnings == ("Campaign 1 is running: its figures may still change.",)


def test_a_grid_is_taken_together(store) -> None:
    ids = [
        run(
            store,
            lambda p, index: p.distance_m < 60.0 and index % 2 == 0,
            episodes=60,
            scenario_parameters={"distance_m": metres},
        )
        for metres in (52.0, 58.0, 64.0, 70.0)
    ]
    found = find_region(store, ids)
    assert found.campaigns == tuple(ids)
    assert found.parameters == ("distance_m",)
    assert [box.words for box in found.boxes] == ["distance at most 58 m"]
    assert found.precision.value == pytest.approx(0.5, abs=0.02)


def test_defaults_and_given_values_make_one_column(store) -> None:
    default = run(store, lambda p, _: False, episodes=30)
    ids = [
        default,
        run(store, lambda p, _: True, episodes=30, scenario_parameters={"distance_m": 70.0}),
    ]
    (box,) = find_region(store, ids).boxes
    assert box.words == "distance at least 70 m"


def test_more_episodes_than_can_be_looked_at_are_sampled(store) -> None:
    campaign = run(store, lambda p, _: p.distance_m < 58.0, scenario_parameters=VARIED)
    found = find_region(store, [campaign], most=150)
    assert found.episodes == 150
    assert "150 of 300 episodes were looked at" in found.warnings[0]


def test_what_else_differs_is_said(store) -> None:
    one = run(store, lambda p, _: True, episodes=30, planner="idm")
    other = run(
        store,
        lambda p, _: False,
        episodes=30,
        method="ast",
        scenario_parameters={"distance_m": 60.0},
    )
    words = " ".join(find_region(store, [one, other]).warnings)
    assert "differ in method, planner" in words
    assert "vary between training runs" in words


def test_fixed_parameters_have_no_region(store) -> None:
    campaign = run(store, lambda p, index: index % 2 == 0, episodes=60)
    assert "No scenario parameter" in find_region(store, [campaign]).problem


def test_before_the_first_episode_there_is_none(store) -> None:
    campaign = running(store, scenario_parameters=VARIED).id
    found = find_region(store, [campaign])
    assert (found.episodes, found.failure_rate) == (0, None)
    assert found.problem


def test_a_function_has_the_parameters_of_its_campaign(store) -> None:
    made = {"simulator": "function", "scenario": "function", "planner": "m:f", "episodes": 50}
    ids = []
    for steps, crash in ((3, True), (4, False)):
        campaign = running(store, **made, scenario_parameters={"steps": steps})
        make = collision if crash else result
        deliver(store, campaign, *(replace(make(index), scene=None) for index in range(50)))
        ids.append(campaign.id)
    (box,) = find_region(store, ids).boxes
    assert box.words == "steps at most 3"


def test_what_cannot_be_asked_is_refused(store) -> None:
    one = running(store).id
    other = running(store, scenario="lead_brake").id
    for ids, complaint in (([], "one or several"), ([one, one], "one or several")):
        with pytest.raises(InvalidValue, match=complaint):
            find_region(store, ids)
    with pytest.raises(InvalidValue, match="different scenarios: cut_in, lead_brake"):
        find_region(store, [one, other])
    with pytest.raises(NotFound):
        find_region(store, [99])


def test_what_is_no_number_is_left_out() -> None:
    rows = [{"side": "left", "cars": 1, "wet": True}, {"side": "right", "cars": 2, "wet": False}]
    names, values, left_out = make_columns(rows)
    assert names == ("cars", "wet")
    assert values.tolist() == [[1.0, 1.0], [2.0, 0.0]]
    assert left_out == ["side is left out: its values are not numbers."]
    assert make_columns([])[1].shape == (0, 0)
