"""Completions of a word in a shell: ids of campaigns, names of plug-ins.

A shell waits for it: whatever is not at hand within a moment is not offered.
"""

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from eigenfail import plugins
from eigenfail.errors import EigenfailError, InvalidValue

if TYPE_CHECKING:
    from eigenfail.client import Client

MOST = 30
SHELLS = ("bash", "zsh", "fish", "powershell", "pwsh")
"""Those that there is a script for."""


def find_shell(named: str) -> str:
    """Return the shell that was named or, without a name, the one that runs this program.

    Raises:
        InvalidValue: there is no script for it, or none was named and none runs this program.
    """
    import shellingham

    try:
        shell = named or shellingham.detect_shell()[0]
    except shellingham.ShellDetectionFailure:
        raise InvalidValue(
            "shell",
            "The shell could not be detected.",
            "Name the shell, as in `eigenfail --show-completion bash`.",
        ) from None
    if shell not in SHELLS:
        remedy = f"Name one of {', '.join(SHELLS)}."
        raise InvalidValue("shell", f"Completion is not available for {shell!r}.", remedy)
    return shell


def make_script(program: str, shell: str) -> str:
    """Return the script that makes a shell complete the commands of a program."""
    # typer has this module, but does not export its functions.
    from typer import completion as scripts

    return str(
        scripts.get_completion_script(  # type: ignore[attr-defined, unused-ignore]
            prog_name=program, complete_var=_name_variable(program), shell=shell
        )
    )


def install_script(program: str, shell: str) -> Path:
    """Write a shell's script where the shell finds it; return its path."""
    from typer import completion as scripts

    _, path = scripts.install(  # type: ignore[attr-defined, unused-ignore]
        shell=shell, prog_name=program, complete_var=_name_variable(program)
    )
    return Path(path)


def _name_variable(program: str) -> str:
    """Name of the environment variable by which a shell asks the program for completions."""
    return f"_{program.replace('-', '_').upper()}_COMPLETE"


def complete_campaigns(context: typer.Context, incomplete: str) -> list[tuple[str, str]]:
    """The newest campaigns of the service that would be asked, with their names."""
    # The HTTP client is loaded only if ids are asked for: each TAB waits for the imports above.
    from eigenfail.cli.connection import find_address

    asked = context.params.get("url") or os.environ.get("EIGENFAIL_URL") or ""
    try:
        with connect(find_address(context, asked)) as client:
            found = client.campaigns.list().first(MOST) if client.health() else ()
    except (EigenfailError, OSError, ValueError):
        return []
    # The shell would filter, too, but some show all that they get.
    ids = [(str(campaign.id), campaign.spec.name) for campaign in found]
    return [(number, name) for number, name in ids if number.startswith(incomplete)]


def connect(url: str) -> "Client":
    """A client of the service at an address."""
    from eigenfail.client import Client

    return Client(url)


def complete_plugins(group: str) -> Callable[[str], list[str]]:
    """Return what completes the names of the plug-ins of a group that are installed here."""

    def complete(incomplete: str) -> list[str]:
        return [name for name in plugins.names(group) if name.startswith(incomplete)]

    return complete
