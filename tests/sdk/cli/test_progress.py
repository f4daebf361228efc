"""Progress: a bar for people, a few plain lines for logs, and results on a stream of their own."""

import time
from io import StringIO

import deadlines
import pytest
from msgspec.structs import replace
from rich.console import Console
from rich.progress import Progress

from eigenfail import progress
from eigenfail.cli.render import follow
from eigenfail.client import Client
from eigenfail.progress import make_standing
from eigenfail.values.campaign import Campaign, CampaignState, Counts
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail_services.store import migrate


class Clock:
    now_s = 100.0


@pytest.fixture
def clock(monkeypatch):
    """The time, as a test sets it."""
    now = Clock()
    monkeypatch.setattr(progress.time, "monotonic", lambda: now.now_s)
    return now


@pytest.fixture
def campaign():
    spec = CampaignSpec(name="x", method="ast", episodes=10)

    def seen(state, completed, failures=0):
        counts = Counts(10, completed, failures)
        return Campaign(id=7, spec=spec, state=CampaignState(state), counts=counts, created_ms=0)

    return seen


def test_plain_lines_come_at_changes_and_now_and_then(campaign, capsys, clock):
    lines = progress.PlainLines()
    steps = (
        (100.0, "queued", 0),
        (101.0, "running", 0),
        (104.9, "running", 5),
        (105.1, "running", 9),
    )
    for clock.now_s, state, completed in steps:
        lines(make_standing(campaign(state, completed)))
    assert capsys.readouterr().err.splitlines() == [
        "campaign 7 (ast) queued: 0/10 episodes, 0 failures",
        "campaign 7 (ast) running: 0/10 episodes, 0 failures",
    ]
    clock.now_s = 106.0
    lines(make_standing(campaign("running", 9, failures=2)))
    assert capsys.readouterr().err == (
        "campaign 7 (ast) running: 9/10 episodes, 2 failures, 1.5 episodes/s, 0:00:01 to go\n"
    )


def test_the_pace_is_that_since_the_first_look(campaign, clock):
    pace = progress.Pace()
    assert pace.words(make_standing(campaign("running", 4))) == "0 failures"
    clock.now_s += 2.0
    words = pace.words(make_standing(campaign("running", 5, failures=1)))
    assert words == "1 failure, 0.5 episodes/s, 0:00:10 to go"
    clock.now_s += 2.0
    assert pace.words(make_standing(campaign("done", 10))) == "0 failures, 1.5 episodes/s"


def test_people_see_a_bar(eigenfail, spec_file, monkeypatch):
    monkeypatch.setenv("TTY_COMPATIBLE", "1")
    done = eigenfail("run", spec_file, "--json")
    assert done.exit_code == 0
    assert "campaign 1 (monte_carlo)" in done.stderr
    assert "24/24" in done.stderr
    assert "━" in done.stderr
    assert done.stdout.startswith("{")


def test_a_campaign_that_stopped_early_is_at_its_end_and_says_why(campaign):
    counts = Counts(10, completed=3, errored=1, cancelled=6)
    stopped = replace(campaign("done", 3), counts=counts)
    with Progress(console=Console(file=StringIO())) as drawn:
        bar = progress.Bar(drawn)
        bar(make_standing(campaign("running", 3)))
        assert not drawn.finished
        bar(make_standing(stopped))
        assert drawn.finished


def test_why_a_campaign_is_done_is_the_last_word(eigenfail, spec_file):
    last = eigenfail("run", spec_file, "--stop-failures", 3).stderr.splitlines()[-1]
    assert last.startswith("campaign 1 (monte_carlo) done: ")
    assert last.endswith(".")


def test_nobody_sees_an_escape_sequence(eigenfail, spec_file):
    done = eigenfail("run", spec_file)
    assert "\x1b" not in done.stdout + done.stderr


def test_a_check_that_raises_ends_the_following(eigenfail, done, service):
    def check():
        raise RuntimeError("the services process is gone")

    with Client("http://127.0.0.1:8440", service) as client, pytest.raises(RuntimeError):
        follow(client, done, check)


def test_a_long_step_says_what_it_is_and_for_how_long(capsys, monkeypatch):
    monkeypatch.setattr(progress, "FIRST_LINE_S", 0.0)
    monkeypatch.setattr(progress, "WAITING_LINE_EVERY_S", 0.01)
    with progress.announce("Reading") as begin:
        assert_written(capsys, "Reading: 0 s so far.")
        begin("Writing")
        assert_written(capsys, "Writing: 0 s so far.")
    capsys.readouterr()
    time.sleep(0.05)
    assert capsys.readouterr().err == ""


def assert_written(capsys, line):
    """Wait until a line is on standard error."""
    until_s = time.monotonic() + deadlines.PROCESS_S
    while line not in capsys.readouterr().err:
        assert time.monotonic() < until_s
        time.sleep(0.01)


def test_a_short_step_says_nothing(capsys):
    with progress.announce("Reading"):
        pass
    assert capsys.readouterr().err == ""


@pytest.fixture
def steps(monkeypatch):
    """The steps of commands that are announced if they last."""
    begun = []

    class Recorded(progress.WaitingLines):
        def __init__(self, step):
            super().__init__(step)
            begun.append(step)

    monkeypatch.setattr(progress, "WaitingLines", Recorded)
    return begun


SUITE = 'name = "Two"\n[base]\nmethod = "monte_carlo"\nepisodes = 2\n[grid]\nseed = [1, 2]\n'
WAITING_COMMANDS = {
    "analyze 1": "Analysing the failures of campaign 1",
    "analyze 1 --prove": "Preparing the replays of analysis 1",
    "suite show {tmp}/suite.toml": "Reading the results of Two",
    "compare 1 1": "Comparing the campaigns",
    "campaign safety 1": "Reading the measures",
    "campaign cost 1": "Reading the costs",
    "campaign course 1": "Reading the episodes",
    "campaign digest 1": "Reading the results",
    "release list": "Reading the versions",
    "release show 1": "Comparing the versions",
    "episode export 1 -o {tmp}/episodes.csv": "Writing {tmp}/episodes.csv",
    "doctor --planner idm": "Checking idm",
    "doctor --database sqlite:///{tmp}/one.db": "Verifying the database",
    "db verify --database sqlite:///{tmp}/one.db": "Verifying the database",
    "db upgrade --database sqlite:///{tmp}/one.db": "Upgrading the schema",
    "db backup {tmp}/copy.db --database sqlite:///{tmp}/one.db": "Writing {tmp}/copy.db",
    "db prune --database sqlite:///{tmp}/one.db": "Removing noise and scenes",
    "db vacuum --database sqlite:///{tmp}/one.db": "Returning free space to the disk",
}


@pytest.mark.parametrize("command", WAITING_COMMANDS)
def test_a_command_that_may_take_long_announces_its_step(command, eigenfail, done, steps, tmp_path):
    (tmp_path / "suite.toml").write_text(SUITE)
    migrate.upgrade(f"sqlite:///{tmp_path}/one.db")
    places = {"tmp": tmp_path}
    steps.clear()
    eigenfail(*command.format(**places).split())
    assert WAITING_COMMANDS[command].format(**places) in steps
