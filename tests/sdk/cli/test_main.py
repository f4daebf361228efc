"""The command line as a whole: light, complete, and never a traceback for an error of ours."""

import subprocess
import sys

import pytest
import typer
from typer.testing import CliRunner

from eigenfail import errors
from eigenfail.cli import main
from eigenfail.cli.main import DeferredCommand

LOADED_BY_HELP = """
import sys
from eigenfail.cli.main import app
app(["--help"], standalone_mode=False)
print(*sorted({name.split(".")[0] for name in sys.modules}), file=sys.stderr)
"""


@pytest.fixture
def runner():
    return CliRunner()


def test_help_lists_every_command_and_loads_nothing_heavy():
    done = subprocess.run(
        [sys.executable, "-c", LOADED_BY_HELP], capture_output=True, text=True, check=True
    )
    assert all(name in done.stdout for name in main.COMMANDS)
    heavy = {"numpy", "httpx2", "msgspec", "torch", "ray", "fastapi", "sqlalchemy", "psutil"}
    assert heavy.isdisjoint(done.stderr.split())


@pytest.mark.parametrize(
    ("habit", "same"),
    [
        (["-h"], ["--help"]),
        (["help"], ["--help"]),
        (["campaign", "-h"], ["campaign", "--help"]),
        (["campaign", "archive", "-h"], ["campaign", "archive", "--help"]),
        (["help", "campaign", "archive"], ["campaign", "archive", "--help"]),
        (["version"], ["--version"]),
        (["version", "--json"], ["--version"]),
    ],
)
def test_words_that_other_tools_have_for_help_and_version(runner, habit, same):
    answer = runner.invoke(main.app, habit)
    assert answer.exit_code == 0
    assert answer.output
    assert answer.output == runner.invoke(main.app, same).output


@pytest.mark.parametrize("name", main.COMMANDS)
def test_every_command_exists_and_is_described_as_it_is_listed(runner, name):
    command = main.defer(name).load()
    assert command.help.splitlines()[0] == main.COMMANDS[name]
    shown = runner.invoke(main.app, [name, "--help"])
    assert shown.exit_code == 0


def test_the_version_is_printed(runner):
    done = runner.invoke(main.app, ["--version"])
    assert done.exit_code == 0
    assert done.output.startswith("eigenfail 0.")


def all_errors(root):
    return [root, *(leaf for kind in root.__subclasses__() for leaf in all_errors(kind))]


@pytest.mark.parametrize("kind", all_errors(errors.EigenfailError))
def test_every_error_is_one_sentence_and_its_exit_code(runner, kind, monkeypatch):
    arguments = {
        errors.UnknownName: ("field", "nme", ["name"]),
        errors.InputError: ("field", "It is wrong.", "Do this."),
        errors.InvalidValue: ("field", "It is wrong.", "Do this."),
    }
    error = kind(*arguments.get(kind, ("It is wrong.", "Do this.")))
    failing = typer.Typer(add_completion=False)

    @failing.command()
    def fail():
        """Fail."""
        raise error

    monkeypatch.setattr(DeferredCommand, "load", lambda self: typer.main.get_command(failing))
    done = runner.invoke(main.app, ["doctor"])
    assert done.exit_code == kind.exit_code
    assert done.stderr == f"eigenfail: {error}\n"
    assert done.stdout == ""
