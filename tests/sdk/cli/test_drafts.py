"""`eigenfail campaign check` and `clone`."""

import json


def test_a_check_prints_all_that_it_would_be_and_launches_nothing(check_session, spec_file, store):
    check_session("cli/check/valid", ("campaign", "check", spec_file, "--episodes", 7))
    assert store.campaigns.page(1).items == ()


def test_a_check_prints_every_problem_and_fails(check_session, eigenfail, spec_file):
    text = spec_file.read_text().replace("name", "# name")
    wrong = '\n[stop]\ncost_usd = 1.0\n[scenario_parameters]\ndistance_m = 9.0\nbogus = "[b]x"\n'
    spec_file.write_text(text + wrong)
    check_session("cli/check/problems", ("campaign", "check", spec_file))
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


def test_what_cannot_be_is_refused(check_session, done):
    clone = ("campaign", "clone")
    wrong = ((done, "--set", "seed"), (done, "--set", "seed=-1"), (99,))
    check_session("cli/errors/clone", *((*clone, *each) for each in wrong))
