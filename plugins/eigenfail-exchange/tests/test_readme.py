"""The plug-in's document: its commands can be given, and its links lead to files."""

import re
import shlex
from pathlib import Path

import typer

from eigenfail.cli.main import app

PLUGIN = Path(__file__).parents[1]
PAGE = PLUGIN / "README.md"


def test_its_commands_can_be_given():
    blocks = re.findall(r"^```sh\n(.*?)^```$", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    lines = [line for line in "".join(blocks).splitlines() if line.startswith("eigenfail")]
    assert len(lines) == 5
    for line in lines:
        words = shlex.split(line)[1:]
        command = typer.main.get_command(app)
        context = command.make_context("eigenfail", list(words))
        while rest := [*getattr(context, "_protected_args", []), *context.args]:
            name, command, rest = command.resolve_command(context, rest)
            context = command.make_context(name, rest, parent=context)
            command = context.command


def test_its_links_lead_to_files():
    links = [part.partition(")")[0] for part in PAGE.read_text().split("](")[1:]]
    files = [link.partition("#")[0] for link in links if not link.startswith(("http", "#"))]
    assert files
    assert [file for file in files if not (PLUGIN / file).exists()] == []
