"""Errors: one line for people, a problem for programs, and the same exit code for both."""

import json

import pytest

UNREACHABLE = ("--url", "http://127.0.0.1:1")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("campain",), "No such command 'campain'. Did you mean 'campaign', 'margin'?"),
        (("campaign", "lst"), "Did you mean 'list'? See: eigenfail campaign --help"),
        (("campaign", "list", "--limt", "3"), "No such option: --limt. Did you mean '--limit'?"),
        (("campaign", "list", "--state", "qeued"), "'dead'. Did you mean 'queued'?"),
        (("analyze", "1", "--axes", "jiont"), "Did you mean 'joint'?"),
        (("run",), "Missing argument 'FILE.toml'. See: eigenfail run --help"),
        (("campaign", "show", "x"), "CAMPAIGN: 'x' is not an integer. `eigenfail campaign list`"),
        (("campaign", "show", "0"), "CAMPAIGN: '0' is below 1. `eigenfail campaign list` shows"),
        (("campaign", "cost", "1", "1.5"), "CAMPAIGN: '1.5' is not an integer."),
        (("analyze", "1", "--also", "0"), "--also: '0' is below 1. `eigenfail campaign list`"),
        (("campaign", "list", "--limit", "x"), "'x' is not an integer. See: eigenfail campaign"),
        (("up", "--port", "65536"), "--port: '65536' is above 65535. See: eigenfail up --help"),
        (("run", "x.toml", "--stop-cv", "x"), "--stop-cv: 'x' is not a number. See: eigenfail run"),
        (("worker",), "--connect: is not given. `eigenfail up` prints the hub's address."),
        (("--jsn",), "No such option: --jsn. See: eigenfail --help"),
    ],
)
def test_a_slip_is_one_line_with_what_was_meant(eigenfail, words, said):
    done = eigenfail(*words)
    assert done.exit_code == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith("eigenfail: ")
    assert said in line


@pytest.mark.parametrize(
    ("words", "code", "kind"),
    [
        (("campaign", "show", "9"), 2, "not-found"),
        (("campaign", "lst"), 2, "input-error"),
        (("campaign", "show", "one"), 2, "invalid-value"),
        (("campaign", "list", "--state", "qeued"), 2, "input-error"),
        (("compare", "1", "x"), 2, "invalid-value"),
        (("worker", "--connect", "nowhere"), 2, "invalid-value"),
    ],
)
def test_a_program_gets_the_problem_and_the_same_exit_code(eigenfail, words, code, kind):
    done = eigenfail(*words, "--json")
    assert done.exit_code == eigenfail(*words).exit_code == code
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    problem = json.loads(line)
    assert problem["type"] == f"urn:eigenfail:{kind}"
    assert problem["detail"]


def test_an_unknown_name_keeps_the_known_ones(eigenfail, spec_file):
    spec_file.write_text(spec_file.read_text().replace("idm", "idn"))
    done = eigenfail("campaign", "create", spec_file, "--json")
    problem = json.loads(done.stderr)
    assert (done.exit_code, problem["name"]) == (2, "idn")
    assert "idm" in problem["known"]
    assert problem["remedy"].startswith("Did you mean 'idm'?")


def test_the_problem_is_the_last_line_behind_the_progress(eigenfail, spec_file, service):
    spec_file.write_text(spec_file.read_text().replace("episodes = 24", "episodes = 8"))
    done = eigenfail("run", spec_file, "--gate", "--json")
    assert done.exit_code in {0, 1}
    assert json.loads(done.stdout)["campaign"] == 1


def test_the_four_exit_codes(eigenfail, spec_file, done):
    assert eigenfail("campaign", "show", done).exit_code == 0
    assert eigenfail("campaign", "watch", done, "--gate").exit_code == 1
    assert eigenfail("campaign", "show", "one").exit_code == 2


def test_trouble_with_the_service_is_exit_code_3(monkeypatch):
    from typer.testing import CliRunner

    from eigenfail.cli.main import app

    done = CliRunner().invoke(app, ["campaign", "show", "1", "--json", *UNREACHABLE])
    assert done.exit_code == 3
    assert json.loads(done.stderr)["type"] == "urn:eigenfail:service-unreachable"


def test_help_stays_help(eigenfail):
    done = eigenfail("campaign")
    assert done.exit_code == 2
    assert "Usage: eigenfail campaign" in done.output
    assert "Exit codes: 0 done" in " ".join(eigenfail("--help").output.split())
