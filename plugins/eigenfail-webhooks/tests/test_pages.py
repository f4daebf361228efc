"""The README and the links of the plug-in's documents."""

import re

from cli_reference import write_commands
from typer.testing import CliRunner

from eigenfail.cli.main import app
from eigenfail_webhooks.addresses import VARIABLE

FOLDER = "plugins/eigenfail-webhooks"
HELP = "Add, list, test and remove webhooks, to which events are sent."
LINK = re.compile(r"\]\(([^)\s]+)\)")


def test_the_reference_is_the_help_of_today(plugin):
    text = (plugin / "README.md").read_text()
    again = f"python tests/support/cli_reference.py {FOLDER}/README.md webhook"
    assert again in text
    assert write_commands(text, ("webhook",)) == text, again


def test_the_list_of_commands_says_what_the_help_of_the_command_says():
    for words in (["--help"], ["webhook", "--help"]):
        done = CliRunner().invoke(app, words)
        assert done.exit_code == 0
        assert HELP in re.sub(r"[│\s]+", " ", done.stdout)


def test_the_variable_is_described(plugin):
    for page in ("README.md", "docs/webhooks.md"):
        assert VARIABLE in (plugin / page).read_text()


def test_links_lead_to_files(plugin):
    for page in (plugin / "README.md", *plugin.glob("docs/*.md")):
        links = [link.partition("#")[0] for link in LINK.findall(page.read_text())]
        local = [link for link in links if link and not link.startswith("https://")]
        assert [link for link in local if not (page.parent / link).exists()] == []
