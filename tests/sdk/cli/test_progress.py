"""Progress: a bar for people, a few plain lines for logs, and results on a stream of their own."""

from io import StringIO

import pytest
from msgspec.structs import replace
from rich.console import Console
from rich.progress import Progress

from eigenfail import progress
from eigenfail.cli.render import follow
from eigenfail.client import Client
from eigenfail.progress import make_standing
from eigenfail.values import Campaign, CampaignSpec, CampaignState, Counts


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
