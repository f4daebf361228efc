"""What is run: the paper's campaigns, at the paper's numbers of episodes."""

import msgspec
import pytest

from eigenfail.cli.specs import check_plugins
from eigenfail.errors import UnknownName
from eigenfail.suites import Suite
from eigenfail.worlds import world_of
from eigenfail_reproduction import paper, tables
from eigenfail_reproduction.programme import CHOSEN, HELD_S, PROGRAMMES, SCALES, SWEEP, build_suite

STEPS = {"cut_in": 700, "highway_drive": 420}


def by_name(suite: Suite):
    return {member.name: member.spec for member in suite.members}


def test_the_full_programme_has_the_papers_episodes():
    found = by_name(build_suite("full"))
    assert found["monte_carlo rulebook"].episodes == found["monte_carlo idm"].episodes == 2000
    assert found["ast_paper"].episodes == found["difs_paper"].episodes == 1000
    assert found["ast_paper evaluation"].episodes == 300
    assert found["ast_paper plus5"].episodes == 100
    swept = [spec for name, spec in found.items() if name.startswith("sweep ")]
    assert len(swept) == 1 + sum(map(len, SWEEP.values())) == 14
    assert {spec.episodes for spec in swept} == {300}


def test_every_row_that_the_paper_prints_is_run():
    names = set(by_name(build_suite("full")))
    for layout in tables.list_layouts(PROGRAMMES["cut_in"]):
        assert set(layout.rows) <= names


def test_settings_are_the_papers_where_they_are_called_so():
    found = by_name(build_suite("full"))
    assert found["ast_paper"].settings.items() >= CHOSEN.items()
    assert found["ast_paper"].settings["trainer"] == "sb3"
    ours = {"hold", "alpha", "c_dist", "entropy"}
    assert found["ast"].settings.keys() == {*ours, "averaged", "converged_share"}
    assert found["difs_paper"].settings == {"schedule": "paper"}
    assert found["sweep alpha=500"].settings["alpha"] == 500
    assert found["sweep alpha=500"].settings["c_dist"] == 1000


def test_evaluations_draw_from_a_seed_of_their_own_and_name_what_they_evaluate():
    found = by_name(build_suite("small", seed=7))
    assert found["ast"].seed == 7
    assert found["ast minus5"].seed == 1007
    assert found["ast minus5"].settings == {"campaign": "ast"}
    trained = found["ast"].scenario_parameters
    assert found["ast minus5"].scenario_parameters == {**trained, "distance_m": 53.0}


def test_buffers_of_the_sweep_hold_as_many_episodes_as_the_papers():
    found = by_name(build_suite("full"))
    sizes = {name: found[f"sweep {name}"].settings["buffer_size"] for name in ("base", "tau=0.01")}
    assert sizes == {"base": 2000, "tau=0.01": 2000}
    assert found["sweep buffer_size=10000"].settings["buffer_size"] == 200
    assert found["ast_paper"].settings["buffer_size"] == 10_000
    drive = by_name(build_suite("full", scenario="highway_drive"))
    assert drive["sweep base"].settings["buffer_size"] == 100_000


@pytest.mark.parametrize("scenario", PROGRAMMES)
def test_noise_that_is_held_and_actions_last_a_second(scenario):
    found = by_name(build_suite("full", scenario=scenario))
    assert found["held"].method == "held"
    assert found["held"].episodes == 2000
    steps = {"held": found["held"].settings["hold"], "ast": found["ast"].settings.get("hold", 10)}
    step_s = PROGRAMMES[scenario].step_s
    assert {name: hold * step_s for name, hold in steps.items()} == {"held": HELD_S, "ast": HELD_S}


def test_cut_in_is_the_example_with_the_papers_steps_and_all_noise(root):
    example = msgspec.toml.decode((root / "examples" / "paper_steps.toml").read_bytes())
    spec = by_name(build_suite("full"))["ast_paper"]
    given = {**spec.scenario_parameters, **example["scenario_parameters"]}
    assert spec.scenario_parameters == given
    assert spec.planner_settings == example["planner_settings"]
    assert by_name(build_suite("full"))["monte_carlo idm"].planner_settings == {}


@pytest.mark.parametrize("scenario", PROGRAMMES)
def test_each_step_lasts_as_long_as_is_said(scenario):
    for spec in by_name(build_suite("small", scenario=scenario)).values():
        assert world_of(spec.simulator).find_form(spec).step_s == PROGRAMMES[scenario].step_s


@pytest.mark.parametrize("scenario", PROGRAMMES)
def test_a_programme_is_a_suite_of_valid_campaigns(scenario):
    """Evaluations name the member that they evaluate, which a service replaces by its number."""
    suite = build_suite("full", scenario=scenario)
    names = {member.name for member in suite.members}
    for member in suite.members:
        spec = member.spec
        assert spec.scenario == scenario
        if spec.method == "evaluate":
            assert spec.settings["campaign"] in names
            spec = msgspec.structs.replace(spec, settings={"campaign": 1})
        check_plugins(spec)
        assert world_of(spec.simulator).find_form(spec).steps == STEPS[scenario]


def test_the_drive_has_noise_of_the_papers_sigma_on_every_vehicle():
    suite = by_name(build_suite("full", scenario="highway_drive"))
    for spec in suite.values():
        names = [channel.name for channel in spec.disturbance.list_channels()]
        assert (names, spec.disturbance.scale) == (["every.longitudinal", "every.lateral"], 1.0)
    moved = suite["ast_paper farther"].scenario_parameters
    assert moved == {"follower_gap_m": 10.0, "slow_gap_m": 80.0, "cut_in_distance_m": 60.0}
    assert suite["ast_paper"].scenario_parameters["slow_gap_m"] == 78.5


@pytest.mark.parametrize("scenario", PROGRAMMES)
def test_the_sweep_has_the_papers_rows(scenario):
    names = by_name(build_suite("full", scenario=scenario))
    assert set(paper.SWEEP) == {name for name in names if name.startswith("sweep ")}


def test_an_unknown_scenario_is_refused_with_the_nearest_one():
    with pytest.raises(UnknownName, match="Did you mean 'highway_drive'"):
        build_suite("full", scenario="highway_drives")


def test_each_scale_has_a_seed_of_its_own():
    seeds = {name: by_name(build_suite(name))["ast"].seed for name in SCALES}
    assert len(set(seeds.values())) == len(SCALES)


def test_scales_make_different_campaigns():
    full, small, learners = (by_name(build_suite(name)) for name in SCALES)
    assert not {spec.name for spec in full.values()} & {spec.name for spec in small.values()}
    assert sum(s.episodes for s in small.values()) < sum(s.episodes for s in full.values()) / 3
    assert set(learners) == {
        name for name in full if name.split()[0] not in {"sweep", "monte_carlo", "held"}
    }
    assert all(spec.episodes == small[name].episodes for name, spec in learners.items())


def test_an_unknown_scale_is_refused_with_the_known_ones():
    with pytest.raises(UnknownName, match="full"):
        build_suite("huge")
