"""The plug-in's documents: their commands run, and what they say is so."""

import re

import deadlines
import pytest
from cli_reference import write_commands
from typed_pages import seen, shell, type_in
from typer.testing import CliRunner

from eigenfail.cli.main import app

FOLDER = "plugins/eigenfail-reports"
HELP = "Write a report on campaigns: one self-contained HTML file, and its data."
LINK = re.compile(r"\]\(([^)\s]+)\)")


@pytest.mark.service
@pytest.mark.timeout(2 * deadlines.TEST_S)
def test_the_page_runs_on_the_campaigns_of_the_demo(tmp_path):
    with shell(tmp_path) as here:
        here.run("eigenfail up --data demo-data")
        here.type("export EIGENFAIL_DATA=demo-data")
        here.run("eigenfail run examples/monte_carlo.toml --episodes 20")
        here.run("eigenfail run examples/ast.toml --episodes 60")
        here.run("eigenfail run examples/difs.toml --episodes 60")
        type_in(f"{FOLDER}/docs/reports.md", here, {})
        seen(here.output, (r"The report is in out/report\.html",))


def test_the_reference_is_the_help_of_today(plugin):
    text = (plugin / "README.md").read_text()
    again = f"python tests/support/cli_reference.py {FOLDER}/README.md report"
    assert again in text
    assert write_commands(text, ("report",)) == text, again


def test_the_list_of_commands_says_what_the_help_of_the_command_says():
    for words in (["--help"], ["report", "--help"]):
        done = CliRunner().invoke(app, words)
        assert done.exit_code == 0
        assert HELP in re.sub(r"[│\s]+", " ", done.stdout)


def test_links_lead_to_files(plugin):
    for page in (plugin / "README.md", *plugin.glob("docs/*.md")):
        links = [link.partition("#")[0] for link in LINK.findall(page.read_text())]
        assert [link for link in links if link and not (page.parent / link).exists()] == []
