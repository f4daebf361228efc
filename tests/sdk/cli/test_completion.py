"""Shell completion, as bash asks for it."""

import pytest
from typer.testing import CliRunner

from eigenfail.cli import completion
from eigenfail.cli.main import COMMANDS, app
from eigenfail.client import Client


@pytest.fixture
def complete(monkeypatch):
    """What bash offers behind these words, the last of which may be begun."""

    def ask(*words):
        monkeypatch.setenv("COMP_WORDS", " ".join(["eigenfail", *words]))
        monkeypatch.setenv("COMP_CWORD", str(len(words)))
        done = CliRunner().invoke(
            app, [], prog_name="eigenfail", env={"_EIGENFAIL_COMPLETE": "complete_bash"}
        )
        return done.stdout.split()

    return ask


def test_the_script_for_bash_is_printed():
    done = CliRunner().invoke(app, ["--show-completion", "bash"], prog_name="eigenfail")
    assert done.exit_code == 0
    assert "_EIGENFAIL_COMPLETE=complete_bash" in done.stdout


def test_commands_complete(complete):
    assert complete("") == list(COMMANDS)
    assert complete("ca") == ["campaign"]
    assert {"list", "show", "create"} <= set(complete("campaign", ""))


def test_options_and_their_values_complete(complete):
    assert complete("campaign", "list", "--st") == ["--state"]
    assert complete("campaign", "list", "--state", "q") == ["queued"]


def test_campaigns_complete(complete, service, done, monkeypatch):
    monkeypatch.setattr(completion, "connect", lambda url: Client(url, service))
    assert complete("campaign", "show", "") == [str(done)]
    assert complete("campaign", "show", "9") == []


def test_plug_ins_complete(complete):
    assert complete("doctor", "--planner", "rul") == ["rulebook"]
    assert complete("doctor", "--scenario", "cut") == ["cut_in"]


def test_no_service_is_no_trouble(complete, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("EIGENFAIL_URL", "http://127.0.0.1:1")
    assert complete("campaign", "show", "") == []
