"""The plug-in's documents: commands can be given, examples run, and links lead to files."""

import re
import shlex
from pathlib import Path

import pytest
import typer

from eigenfail.cli.main import app

PLUGIN = Path(__file__).parents[1]
PAGE = PLUGIN / "README.md"
PAGES = (PAGE, PLUGIN / "docs" / "recorded_traffic.md")


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


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_to_files(page):
    links = [part.partition(")")[0] for part in page.read_text().split("](")[1:]]
    files = [link.partition("#")[0] for link in links if not link.startswith(("http", "#"))]
    assert files
    assert [file for file in files if not (page.parent / file).exists()] == []


def test_the_example_of_recorded_traffic_reads_its_recording(monkeypatch):
    (code,) = re.findall(r"^```python\n(.*?)^```$", PAGES[1].read_text(), re.MULTILINE | re.DOTALL)
    monkeypatch.chdir(PLUGIN / "examples")
    made = {}
    exec(compile(code, "my_recording.py", "exec"), made)
    assert made["MyRecording"].tracks.ids[0] == "truck"
