"""`eigenfail campaign region`: where a planner fails, at a prompt."""

import json

import pytest

from eigenfail.values import Region
from eigenfail.wire.http import decode


@pytest.fixture
def varied(eigenfail, spec_file):
    """A campaign in which the cut-in varies, on a planner that fails in some of it."""
    parameters = "[scenario_parameters]\ndistance_m = { choice = [52.0, 70.0] }\n"
    spec_file.write_text(spec_file.read_text().replace("= 24", "= 120") + parameters)
    run = eigenfail("run", spec_file, "--json")
    assert run.exit_code == 0, run.output
    return json.loads(run.stdout)["campaign"]


def test_a_region_is_a_table_with_its_chance(eigenfail, varied):
    told = eigenfail("campaign", "region", varied)
    assert told.exit_code == 0, told.output
    found = decode(eigenfail("campaign", "region", varied, "--json").stdout.encode(), Region)
    words = " ".join(told.stdout.split())
    assert f"{found.failures} of 120 episodes failed; distance_m varied" in words
    (box,) = found.boxes
    assert box.words == "distance at most 52 m"
    assert f"{box.words} " in words
    assert "Found on half of the episodes, counted on the others: " in words


def test_without_enough_failures_it_says_why_there_is_none(eigenfail, spec_file):
    parameters = "[scenario_parameters]\ndistance_m = { uniform = [52.0, 70.0] }\n"
    spec_file.write_text(spec_file.read_text() + parameters)
    run = eigenfail("run", spec_file, "--json")
    campaign = json.loads(run.stdout)["campaign"]
    told = eigenfail("campaign", "region", campaign)
    found = decode(eigenfail("campaign", "region", campaign, "--json").stdout.encode(), Region)
    assert told.exit_code == 0
    assert not found.boxes
    assert found.problem in " ".join(told.stdout.split())


def test_what_cannot_be_asked_exits_with_2(eigenfail, done):
    for words in ((99,), (done, done), ()):
        assert eigenfail("campaign", "region", *words).exit_code == 2
