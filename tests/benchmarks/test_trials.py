"""The trials of benchmarks/claims.py ask the planners and scenarios what their names say."""

import msgspec
import numpy as np
import pytest
from benchmarks.episode_loop import tasks
from benchmarks.episode_pool import make_setup
from benchmarks.trials import TRIALS
from benchmarks.truth import varied
from benchmarks.truth.known_answers import CLOUD_KINDS, three_modes
from benchmarks.truth.other_scenarios import run_in_process
from benchmarks.truth.undisturbed import UNLIT, drive, grid, worst
from benchmarks.truth.varied import parameter, setting

from eigenfail import plugins
from eigenfail.settings import read_settings


def test_a_setting_is_changed_where_its_path_leads():
    assert list(parameter("distance_m", 53.0, 63.5)) == ["distance_m_53", "distance_m_63.5"]
    (changed,) = setting("tracker.gate", 8.5).values()
    setup = changed.setup("cut_in", "rulebook")
    assert setup.planner_settings == {"tracker": {"gate": 8.5}}
    assert setup.scenario_parameters == {}


@pytest.mark.parametrize(
    ("scenario", "planner", "name"),
    [
        ("cut_in", "idm", "IDM_IN_CUT_IN"),
        ("merge_in", "idm", "IDM_IN_MERGE_IN"),
        ("cut_in", "rulebook", "RULEBOOK_IN_CUT_IN"),
    ],
)
def test_every_variation_is_within_bounds_and_none_is_the_default(scenario, planner, name):
    parameters = plugins.load(plugins.SCENARIOS, scenario).Parameters
    settings = plugins.load(plugins.PLANNERS, planner).Settings
    for variation, changed in getattr(varied, name).items():
        given = read_settings(parameters, dict(changed.parameters), "parameters")
        said = read_settings(settings, dict(changed.settings), "settings")
        assert (given, said) != (parameters(), settings()), variation


def test_no_two_trials_find_the_same_figure():
    prefixes = [prefix for trial in TRIALS for prefix in trial.prefixes]
    assert len(set(prefixes)) == len(prefixes)
    assert [
        (one, other)
        for one in prefixes
        for other in prefixes
        if one != other and one.startswith(other)
    ] == []


def test_a_grid_holds_smallest_default_and_largest_of_each_parameter():
    points = list(grid("lead_brake"))
    assert len(points) == 3**5
    assert {point["gap_m"] for point in points} == {50.0, 60.0, 80.0}


def test_a_drive_without_noise_is_told_by_its_worst():
    calm = drive(msgspec.json.encode(make_setup("cut_in", "rulebook")))
    assert not calm.collided
    assert 0.0 < calm.hardest_braking_mps2 <= 2.0
    assert calm.largest_jerk_mps3 <= 4.01
    assert calm.steps_not_as_planned == 0
    wild = msgspec.structs.replace(calm, collided=True, nearest_m=0.0, hardest_braking_mps2=7.0)
    told = dict(worst("place", [calm, wild]))
    assert (told["place.collisions"].value, told["place.runs"].value) == (1, 2)
    assert told["place.nearest_m"].value == 0.0
    assert told["place.hardest_braking"].value == 7.0


def test_without_brake_lights_the_tracker_is_never_told():
    settings = plugins.load(plugins.PLANNERS, "rulebook").Settings
    lit_from = read_settings(settings, UNLIT, "settings").brake_lights.lit_from_mps2
    parameters = plugins.load(plugins.SCENARIOS, "lead_brake").Parameters
    (schema,) = msgspec.json.schema(parameters)["$defs"].values()
    assert lit_from > schema["properties"]["deceleration_mps2"]["maximum"]


def test_an_episode_of_a_merge_says_when_the_marking_was_crossed():
    setup = msgspec.structs.replace(make_setup("merge_in", "rulebook"), scene_every=1)
    (one,) = run_in_process(msgspec.json.encode(setup), tasks(0, 1, seed=3))
    assert 3.0 < one.crossed_s < 10.0
    assert one.ahead
    assert not one.is_failure


def test_the_planted_modes_are_three_pushes():
    modes = three_modes()
    assert modes.shape == (3, 100, 2)
    assert [int(np.count_nonzero(mode)) for mode in modes] == [15, 15, 15]


def test_one_cloud_is_what_its_name_says():
    nothing = np.zeros((40, 30, 2))
    pushed = {
        kind: made(np.random.default_rng(0), nothing.copy()) for kind, made in CLOUD_KINDS.items()
    }
    assert not pushed["white"].any()
    strong = pushed["push_of_exponential_strength"]
    assert len(np.unique(strong[:, 10, 0])) == 40
    assert not strong[:, :10].any()
    begins = np.argmax(pushed["push_at_any_time"][:, :, 0] > 0.0, axis=1)
    assert len(set(begins.tolist())) > 10
    assert not any(noise[:, :, 1].any() for noise in pushed.values())
