"""The plug-in's document: its commands run, and its reference is what the help says."""

import shutil
from pathlib import Path

import deadlines
import pytest
from cli_reference import write_commands
from typed_pages import shell, type_in

PLUGIN = Path(__file__).parents[1]
PAGE = PLUGIN / "README.md"
NOT_RUN = {
    "pip install": "It installs packages from a registry.",
    "eigenfail noise import": "The reader has the file: test_tier4.py.",
}


@pytest.mark.service
@pytest.mark.timeout(2 * deadlines.TEST_S)
def test_its_commands_run_in_order(tmp_path):
    with shell(tmp_path) as here:
        shutil.copytree(PLUGIN / "examples", here.clone / "plugins" / PLUGIN.name / "examples")
        here.run("eigenfail up")
        type_in(PAGE, here, NOT_RUN)
        assert "shape chosen" in here.output


def test_its_reference_is_the_help_of_today():
    text = PAGE.read_text()
    again = f"python tests/support/cli_reference.py plugins/{PLUGIN.name}/README.md noise"
    assert write_commands(text, ["noise"]) == text, again


def test_the_list_of_commands_says_what_the_help_of_the_command_says(eigenfail):
    for words in (["--help"], ["noise", "--help"]):
        done = eigenfail(*words)
        assert done.exit_code == 0
        assert "Fit the disturbance model p(x) to the log of a sensor" in done.stdout


def test_its_links_lead_to_files():
    links = [part.partition(")")[0] for part in PAGE.read_text().split("](")[1:]]
    files = [link.partition("#")[0] for link in links if not link.startswith(("http", "#"))]
    assert files
    assert [file for file in files if not (PLUGIN / file).exists()] == []
