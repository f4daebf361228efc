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


def test_a_suite_is_run_and_shown_as_one_table(check_session, eigenfail, suite_file):
    run = ("suite", "run", suite_file)
    check_session("cli/suite/run", run, ("suite", "list"), ("suite", "show", "seeds"))
    shown = eigenfail("suite", "show", suite_file)
    assert "\x1b" not in shown.stdout
    assert shown.stdout == eigenfail(*run).stdout
    told = json.loads(eigenfail("suite", "show", "seeds", "--json").stdout)
    assert (told["suite"], told["columns"], told["earlier"]) == ("seeds", ["seed"], 0)


@pytest.mark.fault("campaign whose every episode errors")
def test_a_suite_with_an_errored_member_exits_with_3_and_says_why(check_session, suite_file):
    grid = suite_file.read_text().replace('planner = "idm"\n', "").replace("[1, 2, 3]", "[1]")
    suite_file.write_text(f'{grid}planner = ["idm", "test_raises"]\n')
    check_session("cli/suite/errored", ("suite", "run", suite_file), ("suite", "list"))


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


def test_a_dry_run_tells_the_budget_and_creates_nothing(
    check_session, eigenfail, suite_file, store
):
    dry = ("suite", "run", suite_file, "--dry-run")
    check_session("cli/suite/before", dry, ("suite", "show", suite_file), ("suite", "show", "no"))
    plan = json.loads(eigenfail(*dry, "--json").stdout)
    assert (plan["suite"], plan["campaigns"], plan["episodes"]) == ("seeds", 3, 36)
    assert plan["members"][2]["spec"]["seed"] == 3
    members = json.loads(eigenfail("suite", "show", suite_file, "--json").stdout)["members"]
    assert members[0] == {"name": "seed=1", "state": None, "stopped_because": "", "summary": None}
    assert store.campaigns.page(10).items == ()


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


def test_a_member_runs_behind_the_one_that_it_names(check_session, eigenfail, suite_file, store):
    suite_file.write_text(CHAIN)
    assert eigenfail("suite", "run", suite_file, "--dry-run").exit_code == 0
    check_session("cli/suite/chain", ("suite", "run", suite_file))
    assert store.campaigns.get(2).spec.settings["campaign"] == 1
    eigenfail("suite", "run", suite_file)
    assert len(store.campaigns.page(10).items) == 2


def test_the_gate_closes_if_any_member_found_failures(eigenfail, suite_file):
    assert eigenfail("suite", "run", suite_file).exit_code == 0
    assert eigenfail("suite", "run", suite_file, "--gate").exit_code == 1


def test_a_dead_member_is_service_trouble_after_the_table(check_session, suite_file, service):
    class Deadly(type(service)):
        def run_some(self, campaign):
            if campaign.id == 2:
                self.store.campaigns.move(2, "dead", "The learner ended.")
            else:
                super().run_some(campaign)

    service.__class__ = Deadly
    check_session("cli/suite/dead", ("suite", "run", suite_file, "--gate"))


@pytest.mark.usefixtures("without_plugins")
@pytest.mark.parametrize(
    ("name", "varied"),
    [
        ("no_values", "seed = []"),
        ("field", "sede = [1]"),
        ("planner", 'planner = ["rulebok"]'),
    ],
)
def test_what_is_wrong_in_a_suite_exits_with_2(check_session, suite_file, store, name, varied):
    suite_file.write_text(suite_file.read_text().replace("seed = [1, 2, 3]", varied))
    check_session(f"cli/errors/suite_{name}", ("suite", "run", suite_file))
    assert store.campaigns.page(10).items == ()


def test_people_see_one_bar(eigenfail, suite_file, monkeypatch):
    monkeypatch.setenv("TTY_COMPATIBLE", "1")
    run = eigenfail("suite", "run", suite_file, "--json")
    assert run.exit_code == 0
    assert "3 of 3 campaigns over" in run.stderr
    assert "36/36" in run.stderr
    assert run.stdout.startswith("{")


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


def test_no_member_is_created_unless_all_can_be(check_session, suite_file, store):
    more = '[[campaigns]]\nname = "odd"\nmethod = "cem"\nsettings.rounds = 1\n'
    suite_file.write_text(suite_file.read_text().replace("[grid]\nseed = [1, 2, 3]\n", more))
    suite_file.write_text(suite_file.read_text() + '[[campaigns]]\nname = "even"\n')
    check_session("cli/errors/suite_member", ("suite", "run", suite_file))
    assert store.campaigns.page(1).items == ()
