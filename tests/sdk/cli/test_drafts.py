"""`eigenfail campaign check` and `clone`."""

import json

import pytest

from eigenfail.cli.specs import parse_changes
from eigenfail.errors import InvalidValue


def test_a_check_prints_all_that_it_would_be_and_launches_nothing(eigenfail, spec_file, store):
    done = eigenfail("campaign", "check", spec_file, "--episodes", 7)
    assert done.exit_code == 0, done.output
    assert "It can be launched, as:" in done.stdout
    assert "  settings.round_size = " in done.stdout
    assert "  episodes = 7" in done.stdout
    assert store.campaigns.page(1).items == ()


def test_a_check_prints_every_problem_and_fails(eigenfail, spec_file):
    text = spec_file.read_text().replace("name", "# name")
    wrong = '\n[stop]\ncost_usd = 1.0\n[scenario_parameters]\ndistance_m = 9.0\nbogus = "[b]x"\n'
    spec_file.write_text(text + wrong)
    done = eigenfail("campaign", "check", spec_file)
    assert done.exit_code == 2
    assert "scenario_parameters.distance_m" in done.stdout
    assert "'bogus' is not known" in done.stdout
    found = json.loads(eigenfail("campaign", "check", spec_file, "--json").stdout)
    assert len(found["problems"]) == 2


def test_a_clone_has_other_values(eigenfail, done, store):
    clone = eigenfail(
        *("campaign", "clone", done, "--episodes", 9, "--seed", 2, "--name", "again"),
        *("--set", "settings.round_size=3", "--set", "stop.failures=1", "--json"),
    )
    assert clone.exit_code == 0, clone.output
    made = store.campaigns.get(json.loads(clone.stdout)["id"]).spec
    assert (made.name, made.episodes, made.seed) == ("again", 9, 2)
    assert made.settings["round_size"] == 3
    assert made.stop.failures == 1
    assert made.planner == store.campaigns.get(done).spec.planner


def test_what_cannot_be_is_refused(eigenfail, done):
    assert eigenfail("campaign", "clone", done, "--set", "seed").exit_code == 2
    assert eigenfail("campaign", "clone", done, "--set", "seed=-1").exit_code == 2
    assert eigenfail("campaign", "clone", 99).exit_code == 2


def test_values_are_read_as_what_they_look_like():
    given = ["settings.alpha=1e2", "settings.hidden=[4, 4]", "planner=idm", "name=a=b", "seed=3"]
    assert parse_changes(given) == {
        "settings": {"alpha": 100.0, "hidden": [4, 4]},
        "planner": "idm",
        "name": "a=b",
        "seed": 3,
    }


@pytest.mark.parametrize("wrong", ["", "=3", "a..b=1", "seed"])
def test_values_without_a_field_are_refused(wrong):
    with pytest.raises(InvalidValue, match="FIELD=VALUE"):
        parse_changes([wrong])
