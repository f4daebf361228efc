"""How a gate's baseline is named, and which are refused."""

import json

import pytest


@pytest.mark.parametrize("named", ["trio @ v1", "1,2"])
def test_a_baseline_is_named_by_its_run_or_its_campaigns(eigenfail, suite, gate, named):
    gate("better")
    done = eigenfail(
        "gate", suite("better"), "--planner-version", "v2", "--baseline", named, "--json"
    )
    assert done.exit_code == 0, done.output
    assert [each["baseline"]["campaign"] for each in json.loads(done.stdout)["members"]] == [1, 2]


def test_a_version_of_digits_alone_is_no_campaign(eigenfail, suite, store):
    for version in ("884658975946", "2"):
        words = ("gate", suite("better"), "--planner-version", version)
        assert eigenfail(*words).exit_code == 0
        later = ("gate", suite("better"), "--planner-version", "later", "--json", "--baseline")
        done = eigenfail(*later, version)
        assert done.exit_code == 0, done.output
        members = json.loads(done.stdout)["members"]
        names = {store.campaigns.get(each["baseline"]["campaign"]).spec.name for each in members}
        assert {name.partition(":")[0] for name in names} == {f"trio @ {version}"}


def test_a_suite_that_was_run_is_a_baseline_whose_eigenfailures_are_unproven(
    eigenfail, suite, store
):
    before = suite("usual", "before.toml")
    assert eigenfail("suite", "run", before).exit_code == 0
    words = ("gate", suite("worse"), "--planner-version", "v2", "--json", "--baseline")
    report = json.loads(eigenfail(*words, before).stdout)
    by_name = json.loads(eigenfail(*words, "trio").stdout)
    assert by_name["members"] == report["members"]
    verdicts = {
        known["verdict"]
        for member in report["members"]
        for known in member["known"]
        if known["what"].startswith("eigenfailure")
    }
    assert verdicts <= {"unproven", "safe"}
    assert len(store.analyses.page(10).items) == 4


def test_members_that_the_baseline_lacks_are_told_and_not_judged(eigenfail, baseline, suite):
    file = suite("better", more='[[campaigns]]\nname = "three"\nseed = 3\n')
    done = eigenfail("gate", file, "--planner-version", "v2", "--baseline", "v1")
    assert done.exit_code == 0, done.output
    assert "three: It is not in the baseline." in done.stdout


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--baseline", "v0"), "'v0' contains no members of trio"),
        (("--baseline", "99"), "Campaign 99 does not exist"),
        (("--baseline", ""), "baseline: is empty"),
        (("--baseline", "v2"), "'v2' is the version under test itself"),
        (("--baseline", "lost.toml"), "lost.toml: cannot be read"),
        (("--planner-version", "v 2"), "letters, digits"),
        (("--junit", "/nowhere/gate.xml"), "Folder /nowhere does not exist"),
    ],
)
def test_what_makes_no_sense_exits_with_2(eigenfail, suite, store, words, said):
    count = len(store.campaigns.page(100).items)
    refused = eigenfail("gate", suite("better"), "--planner-version", "v2", *words)
    assert refused.exit_code == 2, refused.output
    assert said in refused.stderr
    assert len(store.campaigns.page(100).items) == count


def test_another_question_is_refused(eigenfail, baseline, suite):
    file = suite()
    file.write_text(
        file.read_text().replace("[base]", "[base]\nscenario_parameters.distance_m = 53.0")
    )
    refused = eigenfail("gate", file, "--planner-version", "v2", "--baseline", "v1")
    assert refused.exit_code == 2
    assert "scenario_parameters of campaign 1, its baseline, differ" in refused.stderr


def test_a_baseline_that_is_not_finished_is_refused(eigenfail, suite, store, tmp_path):
    file = tmp_path / "one.toml"
    file.write_text(
        'name = "trio: one"\nmethod = "monte_carlo"\nplanner = "idm"\nsimulator = "point_mass"\n'
        "episodes = 16\nseed = 1\n"
    )
    created = eigenfail("campaign", "create", file, "--json")
    number = json.loads(created.stdout)["id"]
    store.campaigns.move(number, "paused")
    refused = eigenfail("gate", suite(), "--planner-version", "v2", "--baseline", number)
    assert refused.exit_code == 2, refused.output
    assert f"Campaign {number} of the baseline is paused" in refused.stderr


def test_a_service_elsewhere_needs_the_version_of_its_planner(eigenfail, suite):
    refused = eigenfail("gate", suite(), "--url", "http://127.0.0.1:8440")
    assert refused.exit_code == 2
    assert "planner-version" in refused.stderr


def test_a_baseline_may_write_a_default_out_that_the_suite_leaves_out(eigenfail, suite, gate):
    """Only the service knows the defaults of plug-ins: both sides are compared with them."""
    gate("better")
    distance = "[base.scenario_parameters]\ndistance_m = {distance}\n"
    words = ("--planner-version", "v2", "--baseline", "v1")
    same = eigenfail("gate", suite("better", more=distance.format(distance="58")), *words)
    assert same.exit_code == 0, same.output
    other = eigenfail("gate", suite("better", more=distance.format(distance="60.0")), *words)
    assert other.exit_code == 2, other.output
    assert "scenario_parameters of campaign 1" in " ".join(other.stderr.split())
