"""`eigenfail campaign region`: where a planner fails, at a prompt."""

import json

import pytest

from eigenfail.values import Region
from eigenfail.wire.http import decode


@pytest.fixture
def varied(eigenfail, spec_file):
    """A campaign in which the cut-in varies, on a planner that fails in some of it."""
    parameters = "[scenario_parameters]\ndistance_m = { uniform = [52.0, 70.0] }\n"
    spec_file.write_text(spec_file.read_text().replace("= 24", "= 120") + parameters)
    run = eigenfail("run", spec_file, "--json")
    assert run.exit_code == 0, run.output
    return json.loads(run.stdout)["campaign"]


def test_a_region_or_why_there_is_none(eigenfail, varied):
    told = eigenfail("campaign", "region", varied)
    assert told.exit_code == 0, told.output
    found = decode(eigenfail("campaign", "region", varied, "--json").stdout.encode(), Region)
    words = " ".join(told.stdout.split())
    assert f"{found.failures} of 120 episodes failed; distance_m varied" in words
    assert (found.problem and found.problem in words) or found.boxes[0].words in words


def test_what_cannot_be_asked_exits_with_2(eigenfail, done):
    for words in ((99,), (done, done), ()):
        assert eigenfail("campaign", "region", *words).exit_code == 2
