"""Errors: one line for people, a problem for programs, and the same exit code for both."""

import json

import pytest

UNREACHABLE = ("--url", "http://127.0.0.1:1")


SLIPS = [
    ("campain",),
    ("campaign", "lst"),
    ("campaign", "list", "--limt", "3"),
    ("campaign", "list", "--state", "qeued"),
    ("analyze", "1", "--align", "colision"),
    ("run",),
    ("campaign", "show", "x"),
    ("campaign", "show", "0"),
    ("campaign", "cost", "1", "1.5"),
    ("analyze", "1", "--also", "0"),
    ("campaign", "list", "--limit", "x"),
    ("up", "--port", "65536"),
    ("run", "x.toml", "--stop-cv", "x"),
    ("worker",),
    ("--jsn",),
]


def test_a_slip_is_one_line_with_what_was_meant(check_session, eigenfail):
    check_session("cli/errors/slips", *SLIPS)
    for words in SLIPS:
        (line,) = eigenfail(*words).stderr.splitlines()
        assert line.startswith("eigenfail: ")


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
