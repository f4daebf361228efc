"""docs/cli.md says of every command what its help says."""

from cli_reference import BEGIN, END, describe_commands, write_commands

from eigenfail.cli.main import COMMANDS

AGAIN = "Write it anew: python tests/support/cli_reference.py docs/cli.md"


def test_the_page_is_the_help_of_today(root):
    text = (root / "docs" / "cli.md").read_text()
    assert write_commands(text) == text, AGAIN


def test_every_command_is_on_it_with_its_options(root):
    text = (root / "docs" / "cli.md").read_text()
    assert [name for name in COMMANDS if f"\n## eigenfail {name}\n" not in text] == []
    assert "| `--limit N` | Maximum number of rows. Default: `20`. |" in text
    assert "| `FILE.toml` | The campaign: fields of a CampaignSpec, as TOML. Required. |" in text


def test_what_stands_around_the_commands_is_kept():
    assert (
        write_commands(f"before\n{BEGIN}old\n{END}after\n")
        == f"before\n{BEGIN}\n{describe_commands()}{END}after\n"
    )
