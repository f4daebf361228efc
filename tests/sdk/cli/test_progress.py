"""Progress: a bar for people, a few plain lines for logs, and results on a stream of their own."""

from io import StringIO

import pytest
from msgspec.structs import replace
from rich.console import Console
from rich.progress import Progress

from eigenfail.cli import progress
from eigenfail.client import Client
from eigenfail.values import Campaign, CampaignSpec, CampaignState, Counts


@pytest.fixture
def campaign():
    spec = CampaignSpec(name="x", method="ast", episodes=10)

    def seen(state, completed, failures=0):
        counts = Counts(10, completed, failures)
        return Campaign(id=7, spec=spec, state=CampaignState(state), counts=counts, created_ms=0)

    return seen


def test_plain_lines_come_at_changes_and_now_and_then(campaign, capsys, monkeypatch):
    clock = iter([100.0, 101.0, 104.9, 105.1, 105.2])
    monkeypatch.setattr(progress.time, "monotonic", lambda: next(clock))
    lines = progress.PlainLines()
    steps = (("queued", 0), ("running", 1), ("running", 5), ("running", 9), ("running", 9))
    for state, completed in steps:
        lines(campaign(state, completed))
    assert capsys.readouterr().err.splitlines() == [
        "campaign 7 (ast) queued: 0/10 episodes, 0 failures",
        "campaign 7 (ast) running: 1/10 episodes, 0 failures",
    ]
    monkeypatch.setattr(progress.time, "monotonic", lambda: 106.5)
    lines(campaign("running", 9, failures=2))
    assert capsys.readouterr().err == "campaign 7 (ast) running: 9/10 episodes, 2 failures\n"


def test_people_see_a_bar(eigenfail, spec_file, monkeypatch):
    monkeypatch.setenv("TTY_COMPATIBLE", "1")
    done = eigenfail("run", spec_file, "--json")
    assert done.exit_code == 0
    assert "campaign 1 (monte_carlo)" in done.stderr
    assert "24/24" in done.stderr
    assert "━" in done.stderr
    assert done.stdout.startswith("{")


def test_a_campaign_that_stopped_early_is_at_its_end_and_says_why(campaign):
    counts = Counts(10, completed=3, failed=1, cancelled=6)
    stopped = replace(campaign("done", 3), counts=counts)
    with Progress(console=Console(file=StringIO())) as drawn:
        bar = progress.Bar(drawn)
        bar(campaign("running", 3))
        assert not drawn.finished
        bar(stopped)
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
        progress.follow(client, done, check)
