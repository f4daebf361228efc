"""What `--help` prints is what is written in the commands."""

import re
from pathlib import Path

import pytest
import typer
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


def list_values():
    """The name of each value in the help of any command, with its option or argument."""
    for name in COMMANDS:
        for path, command in below((name,), defer(name)):
            for parameter in getattr(command, "params", ()):
                if hasattr(parameter, "type_descriptor"):
                    shown = parameter.display_type_rich(ctx=typer.Context(command))
                    yield path, parameter, shown or ""


def test_values_have_the_same_names_in_all_commands():
    seen = {}
    for path, parameter, shown in list_values():
        if parameter.param_type_name == "argument":
            assert re.match("[A-Z]", parameter.display_name_raw), (path, parameter.name)
        else:
            assert not re.match(r"<(int|float|str|path|bool|list)\b", shown), (path, shown)
            seen.setdefault((parameter.opts[0], parameter.type_descriptor.annotation), set()).add(
                shown
            )
    several = {option: names for (option, _), names in seen.items() if len(names) > 1}
    # A report is a folder; a plug-in that is checked need not be installed.
    assert several.keys() <= {"--output", "--planner", "--scenario", "--method", "--campaign"}
    assert len(seen) > 80


def test_whole_numbers_are_n_and_files_are_named_by_their_kind():
    kinds = {}
    for _, parameter, shown in list_values():
        if parameter.param_type_name == "option":
            kinds.setdefault(parameter.type_descriptor.annotation, set()).add(shown)
    assert kinds[int] == {"N"}
    assert kinds[float] == {"NUMBER"}
    assert kinds[bool] == {""}
    assert kinds[Path] == {"FILE", "FOLDER", "FILE.toml"}
