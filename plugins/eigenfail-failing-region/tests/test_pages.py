"""The plug-in's document: what it says is so."""

import re

from cli_reference import write_commands
from typer.testing import CliRunner

from eigenfail.cli.main import app

FOLDER = "plugins/eigenfail-failing-region"
HELP = "Show where among the scenario's parameters the episodes of campaigns fail."
LINK = re.compile(r"\]\(([^)\s]+)\)")


def test_the_reference_is_the_help_of_today(plugin):
    text = (plugin / "README.md").read_text()
    again = f"python tests/support/cli_reference.py {FOLDER}/README.md region"
    assert again in text
    assert write_commands(text, ("region",)) == text, again


def test_the_list_of_commands_says_what_the_help_of_the_command_says():
    for words in (["--help"], ["region", "--help"]):
        done = CliRunner().invoke(app, words)
        assert done.exit_code == 0
        assert HELP in re.sub(r"[│\s]+", " ", done.stdout)


def test_links_lead_to_files(plugin):
    text = (plugin / "README.md").read_text()
    links = [link.partition("#")[0] for link in LINK.findall(text)]
    assert [link for link in links if link and not (plugin / link).exists()] == []
