"""The plug-in's document: its reference is what the help says, and its links lead to files."""

from pathlib import Path

from cli_reference import write_commands

PLUGIN = Path(__file__).parents[1]
PAGE = PLUGIN / "README.md"


def test_its_reference_is_the_help_of_today():
    text = PAGE.read_text()
    again = f"python tests/support/cli_reference.py plugins/{PLUGIN.name}/README.md reproduce"
    assert write_commands(text, ["reproduce"]) == text, again


def test_the_list_of_commands_says_what_the_help_of_the_command_says(eigenfail, monkeypatch):
    for name in ("TERMINAL_WIDTH", "COLUMNS"):
        monkeypatch.setenv(name, "200")
    for words in (["--help"], ["reproduce", "--help"]):
        done = eigenfail(*words)
        assert done.exit_code == 0
        assert (
            "Run the paper's experiments, and print our numbers next to the paper's" in done.stdout
        )


def test_its_links_lead_to_files():
    links = [part.partition(")")[0] for part in PAGE.read_text().split("](")[1:]]
    files = [link.partition("#")[0] for link in links if not link.startswith(("http", "#"))]
    assert files
    assert [file for file in files if not (PLUGIN / file).exists()] == []
