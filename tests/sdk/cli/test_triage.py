"""`eigenfail mode triage`, `episode triage`, `note` and `notes`."""

import json
import re
import shlex
from pathlib import Path

import pytest
from msgspec.structs import replace
from store_checks.modes import WORDS, analysed, crashed

from eigenfail.client import Client
from eigenfail.testing.examples import analysis_result

PAGE = (Path(__file__).parents[3] / "docs" / "triage.md").read_text()


@pytest.fixture
def made(store):
    campaign = crashed(store)
    store.campaigns.move(campaign.id, "done")
    return campaign.id, analysed(store, campaign, replace(analysis_result(), words=WORDS))


def test_modes_are_triaged(made, check_session):
    _, analysis = made
    check_session(
        "cli/triage/modes",
        ("mode", "triage", analysis, 1, 2, "--state", "known", "--owner", "anna"),
        ("mode", "triage", analysis, 1, "--label", "late", "--ticket", "https://tickets/7"),
        ("mode", "triage", analysis, 1, "--label", "late"),
        ("mode", "note", analysis, 1, "as in [release 7]"),
        ("mode", "notes", analysis, 2),
        ("mode", "list", analysis, "--label", "late"),
        ("mode", "list", analysis, "--state", "new"),
    )


def test_a_mode_is_shown_with_its_notes(made, eigenfail):
    _, analysis = made
    eigenfail("mode", "triage", analysis, 1, "--state", "not_a_bug")
    for text in ("first", "second"):
        assert eigenfail("mode", "note", analysis, 1, text).exit_code == 0
    shown = eigenfail("mode", "notes", analysis, 1).stdout
    assert "not a bug" in shown
    assert shown.index("second") < shown.index("first")
    told = json.loads(eigenfail("mode", "notes", analysis, 1, "--limit", 1, "--json").stdout)
    assert told["triage"]["state"] == "not_a_bug"
    assert [note["text"] for note in told["notes"]] == ["second"]


def test_episodes_are_triaged(made, check_session):
    campaign, _ = made
    one = f"{campaign}/1"
    check_session(
        "cli/triage/episodes",
        ("episode", "triage", one, "--state", "confirmed", "--label", "late"),
        ("episode", "triage", campaign, "--filter", "severity > 11", "--owner", "anna"),
        ("episode", "triage", campaign, "--filter", "", "--remove-label", "late", "--json"),
        ("episode", "note", one, "seen"),
        ("episode", "list", campaign, "--filter", "owner = anna", "--fields", "index,state,owner"),
    )


def test_what_cannot_be_is_refused(made, check_session):
    campaign, analysis = made
    one = f"{campaign}/1"
    check_session(
        "cli/triage/refused",
        ("episode", "triage", one),
        ("episode", "triage", campaign, "--state", "known"),
        ("episode", "triage", one, "--filter", "mode = 1", "--state", "known"),
        ("episode", "triage", f"{campaign}/99", "--state", "known"),
        ("episode", "triage", "last", "--state", "known"),
        ("episode", "triage", one, "--ticket", "tickets/7"),
        ("mode", "triage", analysis, 1, 3, "--state", "known"),
        ("mode", "note", analysis, 1, " "),
    )


def blocks(language):
    """The blocks of docs/triage.md in a language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


def test_the_page_is_true(made, eigenfail, service):
    shell, python, filters = ("".join(blocks(each)) for each in ("sh", "python", "text"))
    for line in shell.splitlines():
        ran = eigenfail(*shlex.split(line)[1:])
        assert ran.exit_code == 0, (line, ran.stderr)
    with Client(transport=service) as client:
        exec(compile(python, "docs/triage.md", "exec"), {"client": client})
        for text in filters.splitlines():
            client.episodes.list(1, filter=text).first(1)
        assert client.analyses.modes(1)[0].labels == ("cut-in",)
        assert client.triage.get_episode(1, 3).state == "confirmed"
        assert client.triage.get_episode(1, 1).state == "known"
