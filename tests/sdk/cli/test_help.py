"""What `--help` prints is what is written in the commands."""

import re

import pytest
from typer.testing import CliRunner

from eigenfail.cli.main import COMMANDS, DeferredCommand, app, defer

WIDE = {"TERMINAL_WIDTH": "400", "COLUMNS": "400"}


def below(path, command):
    """Each command at or below one, with the words that call it."""
    command = command.load() if isinstance(command, DeferredCommand) else command
    yield path, command
    for name, each in getattr(command, "commands", {}).items():
        yield from below((*path, name), each)


def text_of(help_text):
    """The words of a help text, without the frame and the breaks of a terminal."""
    return " ".join(re.sub("[│─╭╮╰╯]", " ", help_text).split())


@pytest.mark.parametrize("name", COMMANDS)
def test_help_is_printed_literally(name):
    command = defer(name).load()
    for path, each in below((name,), command):
        printed = CliRunner().invoke(app, [*path, "--help"], env=WIDE)
        assert printed.exit_code == 0, printed.output
        shown = text_of(printed.output)
        assert text_of(each.help) in shown, path
        for option in each.params:
            if text := getattr(option, "help", None):
                assert text_of(text) in shown, (path, option.name)


def test_a_check_says_what_quiet_means_for_it():
    printed = text_of(CliRunner().invoke(app, ["campaign", "check", "--help"], env=WIDE).output)
    assert "Print nothing; the exit code gives the result." in printed
    assert "launched campaign" not in printed
