"""`eigenfail suite` against the real API: what runs, what is found again, what is printed."""

import json
import os
import signal

import pytest

from eigenfail.cli.render import INTERRUPTED
from eigenfail.client import Client
from eigenfail.suites import Suite


@pytest.fixture
def suite_file(tmp_path):
    """Three campaigns that take no time and find failures."""
    file = tmp_path / "seeds.toml"
    file.write_text(
        '[base]\nmethod = "monte_carlo"\nplanner = "idm"\nsimulator = "point_mass"\nepisodes = 12\n'
        "[grid]\nseed = [1, 2, 3]\n"
    )
    return file


def rows(printed):
    return [line.split() for line in printed.splitlines()[2:]]


def test_a_suite_is_run_and_shown_as_one_table(eigenfail, suite_file):
    run = eigenfail("suite", "run", suite_file)
    assert run.exit_code == 0, run.output
    header, _, *table = run.stdout.splitlines()
    assert header.split()[:5] == ["member", "state", "id", "method", "episodes"]
    assert "failure rate [95 %]" in header
    found = [row[:5] for row in map(str.split, table[:3])]
    assert found == [[f"seed={n}", "done", f"{n}", "monte_carlo", "12"] for n in (1, 2, 3)]
    assert "seeds: 3 of 3 campaigns over: 36/36 episodes" in run.stderr
    assert "\x1b" not in run.stdout + run.stderr
    assert eigenfail("suite", "show", suite_file).stdout == run.stdout


@pytest.mark.fault("campaign whose every episode errors")
def test_a_suite_with_an_errored_member_exits_with_3_and_says_why(eigenfail, suite_file):
    grid = suite_file.read_text().replace('planner = "idm"\n', "").replace("[1, 2, 3]", "[1]")
    suite_file.write_text(f'{grid}planner = ["idm", "test_raises"]\n')
    run = eigenfail("suite", "run", suite_file)
    assert run.exit_code == 3, run.output
    assert "All 12 episodes errored" in run.stderr
    assert "run the suite under a different name" in run.stderr
    assert "a stranger's bug" in run.stderr
    states = [row.split()[2] for row in run.stdout.splitlines()[2:4]]
    assert states == ["done", "errored"]
    assert "1 done, 1 errored" in " ".join(eigenfail("suite", "list").stdout.split())


def test_run_again_it_does_nothing_twice(eigenfail, suite_file, store):
    first = eigenfail("suite", "run", suite_file, "--json")
    again = eigenfail("suite", "run", suite_file, "--json")
    assert first.stdout == again.stdout
    assert len(store.campaigns.page(10).items) == 3


def test_a_client_that_was_killed_goes_on(eigenfail, suite_file, service, store):
    # What it leaves: some members created, one of them at work, the others unknown.
    suite = Suite.read(suite_file)
    with Client(transport=service) as client:
        client.suites.create(Suite(suite.name, suite.members[1:]))
    run = eigenfail("suite", "run", suite_file, "--json")
    assert run.exit_code == 0, run.output
    members = json.loads(run.stdout)["members"]
    assert [member["summary"]["campaign"] for member in members] == [3, 1, 2]
    assert {member["summary"]["counts"]["completed"] for member in members} == {12}


def test_a_dry_run_tells_the_budget_and_creates_nothing(eigenfail, suite_file, store):
    dry = eigenfail("suite", "run", suite_file, "--dry-run")
    assert dry.exit_code == 0
    assert "seeds: 3 campaigns, 36 episodes in all" in dry.stdout
    plan = json.loads(eigenfail("suite", "run", suite_file, "--dry-run", "--json").stdout)
    assert (plan["suite"], plan["campaigns"], plan["episodes"]) == ("seeds", 3, 36)
    assert plan["members"][2]["spec"]["seed"] == 3
    assert store.campaigns.page(10).items == ()


def test_before_it_runs_the_table_holds_dashes(eigenfail, suite_file):
    shown = eigenfail("suite", "show", suite_file)
    assert shown.exit_code == 0
    assert rows(shown.stdout)[0] == ["seed=1", *"–" * 10]
    members = json.loads(eigenfail("suite", "show", suite_file, "--json").stdout)["members"]
    assert members[0] == {"name": "seed=1", "state": None, "stopped_because": "", "summary": None}


def test_ctrl_c_pauses_all_and_the_same_command_goes_on(eigenfail, suite_file, service, store):
    class Interrupting(type(service)):
        def run_some(self, campaign):
            super().run_some(campaign)
            if campaign.id == 2 and campaign.counts.completed == 0:
                os.kill(os.getpid(), signal.SIGINT)

    suite_file.write_text(suite_file.read_text().replace("episodes = 12", "episodes = 48"))
    service.__class__ = Interrupting
    stopped = eigenfail("suite", "run", suite_file)
    assert stopped.exit_code == INTERRUPTED
    assert f"To continue: eigenfail suite run {suite_file}" in stopped.stderr
    assert [campaign.state for campaign in store.campaigns.page(10).items] == ["paused"] * 3
    assert "seeds: 0 of 3 campaigns over, 3 paused: " in stopped.stderr
    assert eigenfail("suite", "run", suite_file).exit_code == 0
    assert [campaign.state for campaign in store.campaigns.page(10).items] == ["done"] * 3
    assert [campaign.counts.completed for campaign in store.campaigns.page(10).items] == [48] * 3


CHAIN = """
[base]
planner = "idm"
simulator = "point_mass"
episodes = 12

[[campaigns]]
name = "again"
method = "replay"
settings.campaign = "searched"
scenario_parameters.distance_m = 60.0
settings.episodes = [0, 1]
episodes = 2

[[campaigns]]
name = "searched"
method = "monte_carlo"
"""


def test_a_member_runs_behind_the_one_that_it_names(eigenfail, suite_file, store):
    suite_file.write_text(CHAIN)
    assert eigenfail("suite", "run", suite_file, "--dry-run").exit_code == 0
    run = eigenfail("suite", "run", suite_file)
    assert run.exit_code == 0, run.output
    *members, note = rows(run.stdout)
    assert " ".join(note).startswith("A rate without an interval is a share of the episodes")
    assert [row[:5] for row in members] == [
        ["again", "done", "2", "replay", "2"],
        ["searched", "done", "1", "monte_carlo", "12"],
    ]
    assert store.campaigns.get(2).spec.settings["campaign"] == 1
    assert "seeds: 2 of 2 campaigns over: 14/14 episodes" in run.stderr
    again = eigenfail("suite", "run", suite_file)
    assert again.stdout == run.stdout
    assert len(store.campaigns.page(10).items) == 2


def test_before_what_it_names_is_done_a_member_has_no_campaign(
    eigenfail, suite_file, service, store
):
    class Interrupting(type(service)):
        def run_some(self, campaign):
            super().run_some(campaign)
            os.kill(os.getpid(), signal.SIGINT)

    suite_file.write_text(CHAIN)
    service.__class__, working = Interrupting, service.__class__
    stopped = eigenfail("suite", "run", suite_file)
    assert stopped.exit_code == INTERRUPTED
    assert [campaign.spec.method for campaign in store.campaigns.page(10).items] == ["monte_carlo"]
    assert rows(eigenfail("suite", "show", suite_file).stdout)[0] == ["again", *"–" * 10]
    service.__class__ = working
    assert eigenfail("suite", "run", suite_file).exit_code == 0
    assert [campaign.state for campaign in store.campaigns.page(10).items] == ["done"] * 2


def test_the_gate_closes_if_any_member_found_failures(eigenfail, suite_file):
    assert eigenfail("suite", "run", suite_file).exit_code == 0
    assert eigenfail("suite", "run", suite_file, "--gate").exit_code == 1


def test_a_dead_member_is_service_trouble_after_the_table(eigenfail, suite_file, store, service):
    class Deadly(type(service)):
        def run_some(self, campaign):
            if campaign.id == 2:
                self.store.campaigns.move(2, "dead", "The learner ended.")
            else:
                super().run_some(campaign)

    service.__class__ = Deadly
    run = eigenfail("suite", "run", suite_file, "--gate")
    assert run.exit_code == 3
    assert "Campaign 2 is dead: The learner ended." in run.stderr
    assert rows(run.stdout)[1][:3] == ["seed=2", "dead", "2"]


@pytest.mark.parametrize(
    ("varied", "words"),
    [
        ("seed = []", "has no values"),
        ("sede = [1]", "Did you mean 'seed'?"),
        ('planner = ["rulebok"]', "Did you mean 'rulebook'?"),
    ],
)
def test_what_is_wrong_in_a_suite_exits_with_2(eigenfail, suite_file, store, varied, words):
    suite_file.write_text(suite_file.read_text().replace("seed = [1, 2, 3]", varied))
    refused = eigenfail("suite", "run", suite_file)
    assert refused.exit_code == 2
    assert words in refused.stderr
    assert store.campaigns.page(10).items == ()


def test_people_see_one_bar(eigenfail, suite_file, monkeypatch):
    monkeypatch.setenv("TTY_COMPATIBLE", "1")
    run = eigenfail("suite", "run", suite_file, "--json")
    assert run.exit_code == 0
    assert "3 of 3 campaigns over" in run.stderr
    assert "36/36" in run.stderr
    assert run.stdout.startswith("{")


def test_suites_of_a_service_are_listed_and_shown_by_their_names(eigenfail, suite_file):
    assert eigenfail("suite", "run", suite_file).exit_code == 0
    listed = eigenfail("suite", "list")
    assert rows(listed.stdout) == [["seeds", "3", "done", "3", "36/36", "10"]], listed.output
    shown = eigenfail("suite", "show", "seeds")
    header, _, *table = shown.stdout.splitlines()
    assert header.split()[:4] == ["member", "state", "seed", "id"]
    assert [row.split()[:4] for row in table[:3]] == [
        [f"seed={n}", "done", f"{n}", f"{n}"] for n in (1, 2, 3)
    ]
    told = json.loads(eigenfail("suite", "show", "seeds", "--json").stdout)
    assert (told["suite"], told["columns"], told["earlier"]) == ("seeds", ["seed"], 0)


def test_settings_that_a_member_leaves_out_are_the_default(eigenfail, tmp_path):
    file = tmp_path / "budgets.toml"
    file.write_text(
        '[base]\nmethod = "monte_carlo"\nplanner = "idm"\nsimulator = "point_mass"\nepisodes = 2\n'
        "[sweep.scenario_parameters]\ndistance_m = [60.0]\n"
    )
    assert eigenfail("suite", "run", file).exit_code == 0
    columns, _, *table = eigenfail("suite", "show", "budgets").stdout.splitlines()
    assert "distance_m" in columns.split()
    assert ["default" in row.split() for row in table] == [True, False]


def test_a_suite_that_the_service_does_not_know_is_an_error(eigenfail):
    shown = eigenfail("suite", "show", "nobody")
    assert shown.exit_code == 2
    assert "eigenfail suite list" in shown.stderr


def test_no_member_is_created_unless_all_can_be(eigenfail, suite_file, store):
    more = '[[campaigns]]\nname = "odd"\nmethod = "cem"\nsettings.rounds = 1\n'
    suite_file.write_text(suite_file.read_text().replace("[grid]\nseed = [1, 2, 3]\n", more))
    suite_file.write_text(suite_file.read_text() + '[[campaigns]]\nname = "even"\n')
    refused = eigenfail("suite", "run", suite_file)
    assert refused.exit_code == 2
    assert "member 'odd': settings: 'rounds' is not known." in refused.stderr
    assert store.campaigns.page(1).items == ()
