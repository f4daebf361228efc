"""What commands print: JSON for programs, tables for people; with `--watch`, again and again."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import msgspec
import numpy as np
import typer
from rich.console import Console, RenderableType
from rich.live import Live

from eigenfail.client.campaigns import AT_REST
from eigenfail.client.waiting import wait_until
from eigenfail.progress import PlainLines, standing
from eigenfail.values import Campaign

PLAIN_WIDTH = 1_000
"""Of pipes and files: no row is broken there. [characters]"""


def _make_plain(value: Any) -> Any:
    """An array as nested lists, for JSON."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} has no JSON form.")


def to_json(value: Any, indent: int = 2) -> str:
    """A value of ours as JSON; on one line with an indent of 0."""
    return msgspec.json.format(
        msgspec.json.encode(value, enc_hook=_make_plain), indent=indent
    ).decode()


def make_console() -> Console:
    """Where tables go; wide enough to keep every row on one line when nobody looks."""
    screen = Console(highlight=False)
    return screen if screen.is_terminal else Console(highlight=False, width=PLAIN_WIDTH)


def show(value: Any, as_json: bool, draw: Callable[[], RenderableType]) -> None:
    """Print a value: as JSON, or as it is drawn for people."""
    if as_json:
        typer.echo(to_json(value))
        return
    make_console().print(draw())


Seen = TypeVar("Seen")

POLL_S = 1.0


@dataclass(frozen=True)
class TerminalView(Generic[Seen]):
    """What a command shows.

    Attributes:
        look: what is to be seen now.
        campaigns: those in it; watching ends once all of them have ended or are paused.
        told: it, for programs.
        draw: it, for people.
    """

    look: Callable[[], Seen]
    campaigns: Callable[[Seen], Iterable[Campaign]]
    told: Callable[[Seen], object]
    draw: Callable[[Seen], RenderableType]

    def show(self, as_json: bool) -> None:
        """Print it once."""
        seen = self.look()
        show(self.told(seen), as_json, lambda: self.draw(seen))

    def watch(self, as_json: bool) -> None:
        """Show it again and again: in one place of a terminal, elsewhere what has changed."""
        screen = make_console()
        if as_json:
            self.until_rest(_JsonChanges(self.told))
        elif screen.is_terminal:
            with Live(console=screen, auto_refresh=False) as live:
                self.until_rest(lambda seen: live.update(self.draw(seen), refresh=True))
        else:
            screen.print(self.draw(self.until_rest(_ProgressLines(self.campaigns))))

    def until_rest(self, tell: Callable[[Seen], None]) -> Seen:
        """The last look, at which all campaigns are at rest; each look is told of."""

        def look() -> Seen:
            seen = self.look()
            tell(seen)
            return seen

        def at_rest(seen: Seen) -> bool:
            return all(campaign.state in AT_REST for campaign in self.campaigns(seen))

        return wait_until(look, at_rest, POLL_S, None)


class _JsonChanges(Generic[Seen]):
    """Prints it as JSON on one line, whenever it is not what it was."""

    def __init__(self, told: Callable[[Seen], object]) -> None:
        self.told = told
        self.last = ""

    def __call__(self, seen: Seen) -> None:
        """Print it, if it has changed."""
        now = to_json(self.told(seen), indent=0)
        if now != self.last:
            typer.echo(now)
        self.last = now


class _ProgressLines(Generic[Seen]):
    """Prints a line for each campaign whenever its state changes, and now and then."""

    def __init__(self, campaigns: Callable[[Seen], Iterable[Campaign]]) -> None:
        self.campaigns = campaigns
        self.lines: dict[int, PlainLines] = {}

    def __call__(self, seen: Seen) -> None:
        """Print the lines that are due."""
        for campaign in self.campaigns(seen):
            self.lines.setdefault(campaign.id, PlainLines(typer.echo))(standing(campaign))
