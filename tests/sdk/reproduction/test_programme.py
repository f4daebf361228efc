"""What is run: the paper's campaigns, at the paper's numbers of episodes."""

import pytest

from eigenfail.errors import UnknownName
from eigenfail.reproduction import tables
from eigenfail.reproduction.programme import CHOSEN, SCALES, STEP_S, SWEEP, build_suite
from eigenfail.suites import Suite
from eigenfail.worlds import world_of


def by_name(suite: Suite):
    return {member.name: member.spec for member in suite.members}


def test_the_full_programme_has_the_papers_episodes():
    found = by_name(build_suite("full"))
    assert found["monte_carlo rulebook"].episodes == found["monte_carlo idm"].episodes == 2000
    assert found["ast_paper"].episodes == found["difs_paper"].episodes == 1000
    assert found["ast_paper evaluation"].episodes == 300
    assert found["ast_paper plus5"].episodes == 100
    swept = [spec for name, spec in found.items() if name.startswith("sweep ")]
    assert len(swept) == 1 + sum(map(len, SWEEP.values())) == 11
    assert {spec.episodes for spec in swept} == {300}


def test_every_row_that_the_paper_prints_is_run():
    names = set(by_name(build_suite("full")))
    for rows in (tables.PLANNERS, tables.SWEEP, tables.TRAINING, tables.EVALUATION):
        assert set(rows) <= names
    assert set(tables.GENERALISATION) <= names


def test_settings_are_the_papers_where_they_are_called_so():
    found = by_name(build_suite("full"))
    assert found["ast_paper"].settings == dict(CHOSEN)
    assert found["ast"].settings == {}
    assert found["difs_paper"].settings == {"schedule": "paper"}
    assert found["sweep alpha=500"].settings["alpha"] == 500
    assert found["sweep alpha=500"].settings["c_dist"] == 1000


def test_evaluations_draw_from_a_seed_of_their_own_and_name_what_they_evaluate():
    found = by_name(build_suite("small", seed=7))
    assert found["ast"].seed == 7
    assert found["ast minus5"].seed == 1007
    assert found["ast minus5"].settings == {"campaign": "ast"}
    assert found["ast minus5"].scenario_parameters == {"distance_m": 53.0}


def test_each_step_lasts_as_long_as_is_said():
    for spec in by_name(build_suite("small")).values():
        assert world_of(spec.simulator).step_s(spec) == STEP_S


def test_each_scale_has_a_seed_of_its_own():
    seeds = {name: by_name(build_suite(name))["ast"].seed for name in SCALES}
    assert len(set(seeds.values())) == len(SCALES)


def test_scales_make_different_campaigns():
    full, small = (by_name(build_suite(name)) for name in SCALES)
    assert not {spec.name for spec in full.values()} & {spec.name for spec in small.values()}
    assert sum(s.episodes for s in small.values()) < sum(s.episodes for s in full.values()) / 3


def test_an_unknown_scale_is_refused_with_the_known_ones():
    with pytest.raises(UnknownName, match="full"):
        build_suite("huge")
