"""docs/cli.md says of every command what its help says."""

from cli_reference import BEGIN, END, describe_commands, write_commands

AGAIN = "Write it anew: python tests/support/cli_reference.py docs/cli.md"


def test_the_page_is_the_help_of_today(root):
    text = (root / "docs" / "cli.md").read_text()
    assert write_commands(text) == text, AGAIN


def test_what_stands_around_the_commands_is_kept():
    assert (
        write_commands(f"before\n{BEGIN}old\n{END}after\n")
        == f"before\n{BEGIN}\n{describe_commands()}{END}after\n"
    )
