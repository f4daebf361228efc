"""`eigenfail region`: where a planner fails, at a prompt."""

import json

import pytest

from eigenfail import progress
from eigenfail.wire.http import decode
from eigenfail_failing_region.values import Region


@pytest.fixture
def varied(eigenfail, spec_file):
    """A campaign in which the cut-in varies, on a planner that fails in some of it."""
    parameters = "[scenario_parameters]\ndistance_m = { choice = [52.0, 70.0] }\n"
    spec_file.write_text(spec_file.read_text().replace("= 24", "= 120") + parameters)
    run = eigenfail("run", spec_file, "--json")
    assert run.exit_code == 0, run.output
    return json.loads(run.stdout)["campaign"]


def test_a_region_is_a_table_with_its_chance(check_session, eigenfail, varied):
    found = decode(eigenfail("region", varied, "--json").stdout.encode(), Region)
    (box,) = found.boxes
    assert box.words == "distance at most 52 m"
    check_session("cli/region/found", ("region", varied))


def test_without_enough_failures_it_says_why_there_is_none(check_session, eigenfail, spec_file):
    parameters = "[scenario_parameters]\ndistance_m = { uniform = [52.0, 70.0] }\n"
    spec_file.write_text(spec_file.read_text() + parameters)
    assert eigenfail("run", spec_file).exit_code == 0
    check_session("cli/region/none", ("region", 1))


def test_what_cannot_be_asked_exits_with_2(check_session, done):
    check_session(
        "cli/errors/region",
        *(("region", *words) for words in ((99,), (done, done), ())),
    )


def test_the_step_that_may_take_long_is_announced(eigenfail, done, monkeypatch):
    begun = []

    class Recorded(progress.WaitingLines):
        def __init__(self, step):
            super().__init__(step)
            begun.append(step)

    monkeypatch.setattr(progress, "WaitingLines", Recorded)
    assert eigenfail("region", done).exit_code == 0
    assert "Searching for the failing region" in begun
