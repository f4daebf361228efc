"""`eigenfail mode triage`."""

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
        ("mode", "triage", analysis, 2),
        ("mode", "list", analysis, "--state", "new"),
    )


def test_a_mode_is_changed_and_shown(made, eigenfail):
    _, analysis = made
    asked = ("mode", "triage", analysis, 1)
    assert eigenfail(*asked, "--state", "not_a_bug", "--note", "as in [release 7]").exit_code == 0
    assert eigenfail(*asked, "--ticket", "https://tickets/7").exit_code == 0
    shown = eigenfail(*asked).stdout
    for words in ("not a bug", "as in [release 7]", "https://tickets/7", "loopback"):
        assert words in shown
    told = json.loads(eigenfail(*asked, "--ticket", "", "--json").stdout)
    assert (told["state"], told["ticket"], told["note"]) == ("not_a_bug", "", "as in [release 7]")
    (other,) = json.loads(eigenfail("mode", "list", analysis, "--state", "new", "--json").stdout)
    assert other["number"] == 2


def test_what_cannot_be_is_refused(made, check_session):
    _, analysis = made
    check_session(
        "cli/triage/refused",
        ("mode", "triage", analysis, 3, "--state", "known"),
        ("mode", "triage", analysis, 1, "--ticket", "tickets/7"),
    )


def blocks(language):
    """The blocks of docs/triage.md in a language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


def test_the_page_is_true(made, eigenfail, service):
    shell, python = ("".join(blocks(each)) for each in ("sh", "python"))
    for line in shell.splitlines():
        ran = eigenfail(*shlex.split(line)[1:])
        assert ran.exit_code == 0, (line, ran.stderr)
    with Client(transport=service) as client:
        exec(compile(python, "docs/triage.md", "exec"), {"client": client})
        assert client.triage.get_mode(1, 1).note == "As in release 7."
        assert client.triage.get_mode(1, 1).state == "known"
