"""Progress of campaigns: a bar in terminals and notebooks, plain lines elsewhere."""

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import timedelta
from html import escape
from typing import Any, NamedTuple

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from eigenfail.values.campaign import Campaign

LINE_EVERY_S = 5.0
FIRST_LINE_S = 5.0
"""A step that is over by then is not worth a line."""
WAITING_LINE_EVERY_S = 10.0

Report = Callable[[Campaign], None]


class Standing(NamedTuple):
    """Progress of an operation, in episodes."""

    headline: str
    done: int
    total: int
    failures: int
    errored: int = 0


Display = Callable[[Standing], None]


def make_standing(campaign: Campaign) -> Standing:
    """Return the progress of a campaign."""
    counts = campaign.counts
    done = counts.completed + counts.errored
    planned = counts.planned - counts.cancelled
    return Standing(format_headline(campaign), done, planned, counts.failures, counts.errored)


def format_headline(campaign: Campaign) -> str:
    """Return a campaign's id, method and state as text."""
    return f"campaign {campaign.id} ({campaign.spec.method}) {campaign.state_word}"


@contextmanager
def reporter() -> Iterator[Report]:
    """Show the progress of one campaign during the block."""
    with display() as show:
        yield lambda campaign: show(make_standing(campaign))


@contextmanager
def display() -> Iterator[Display]:
    """Yield a display on standard error, as standard output holds results, or in the notebook."""
    screen = Console(stderr=True, highlight=False)
    # First: the output of a kernel is no terminal, and would get plain lines.
    if screen.is_jupyter:
        yield NotebookBar()
    elif not screen.is_terminal:
        yield PlainLines()
    else:
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
        words = TextColumn("{task.fields[words]}")
        # It disappears in the end, as the result that follows says the same.
        with Progress(*columns, words, console=screen, transient=True) as progress:
            yield Bar(progress)


class Pace:
    """Episodes per second since the first call, and the remaining time at that rate."""

    def __init__(self) -> None:
        self.first: tuple[float, int] | None = None

    def words(self, seen: Standing) -> str:
        """Return the number of failures; also rate and remaining time once they are known."""
        now_s = time.monotonic()
        if self.first is None:
            # Episodes that ended before the first look took a time that is not known here.
            self.first = (now_s, seen.done)
        elapsed_s, done = now_s - self.first[0], seen.done - self.first[1]
        text = f"{seen.failures} failure{'s' * (seen.failures != 1)}"
        text += f", {seen.errored} errored" if seen.errored else ""
        if done <= 0 or elapsed_s <= 0.0:
            return text
        rate = done / elapsed_s
        left = timedelta(seconds=round((seen.total - seen.done) / rate))
        return f"{text}, {rate:.1f} episodes/s" + (f", {left} to go" if left else "")


class Bar:
    """A progress bar with failures, rate and remaining time."""

    def __init__(self, progress: Progress) -> None:
        self.progress = progress
        self.pace = Pace()
        self.task = progress.add_task("", words="")

    def __call__(self, seen: Standing) -> None:
        """Draw the bar for the present progress."""
        self.progress.update(
            self.task,
            description=seen.headline,
            completed=seen.done,
            total=seen.total,
            words=self.pace.words(seen),
        )


class PlainLines:
    """A line at every change of the headline, and every few seconds between."""

    def __init__(self, write: Callable[[str], None] | None = None) -> None:
        self.write = write or on_standard_error
        self.headline = ""
        self.last_s = 0.0
        self.pace = Pace()

    def __call__(self, seen: Standing) -> None:
        """Print a line, if one is due."""
        now_s, words = time.monotonic(), self.pace.words(seen)
        if seen.headline == self.headline and now_s - self.last_s < LINE_EVERY_S:
            return
        self.headline, self.last_s = seen.headline, now_s
        self.write(f"{seen.headline}: {seen.done}/{seen.total} episodes, {words}")


class WaitingLines:
    """Lines that name the step that a command waits for, and the time since its start.

    Args:
        step: name of the step, such as "Analysing the failures of campaign 2".
    """

    def __init__(self, step: str) -> None:
        self._step = step
        self._began_s = time.monotonic()
        # An event, not a flag: the writer sleeps on it, and ends at once.
        self._is_over = threading.Event()

    def begin(self, step: str) -> None:
        """Name the next step, and restart the time."""
        self._step, self._began_s = step, time.monotonic()

    def end(self) -> None:
        """Write no further line."""
        self._is_over.set()

    def write(self) -> None:
        """Write a line after some seconds, then repeatedly until the end."""
        due_s = FIRST_LINE_S
        while not self._is_over.wait(due_s):
            elapsed_s = time.monotonic() - self._began_s
            on_standard_error(f"{self._step}: {elapsed_s:.0f} s so far.")
            due_s = WAITING_LINE_EVERY_S


@contextmanager
def announce(step: str) -> Iterator[Callable[[str], None]]:
    """Show on standard error what a command waits for, if the block takes more than a moment.

    Yields:
        A function that names the next step of the block.
    """
    lines = WaitingLines(step)
    writer = threading.Thread(target=lines.write, name="waiting lines", daemon=True)
    writer.start()
    try:
        yield lines.begin
    finally:
        lines.end()
        writer.join()


def on_standard_error(line: str) -> None:
    """Write a line to standard error, since results go to standard output."""
    sys.stderr.write(f"{line}\n")


class NotebookBar:
    """A bar below a notebook's cell, redrawn in one place."""

    def __init__(self) -> None:
        self.pace = Pace()
        self.place: Any = None

    def __call__(self, seen: Standing) -> None:
        """Draw the bar for the present progress."""
        from IPython.display import HTML, display

        drawing = HTML(bar_html(seen, self.pace.words(seen)))  # type: ignore[no-untyped-call]
        if self.place is None:
            self.place = display(drawing, display_id=True)  # type: ignore[no-untyped-call]
        else:
            self.place.update(drawing)


def bar_html(seen: Standing, words: str) -> str:
    """Return a progress bar with a text, as HTML."""
    # HTML allows no maximum of 0.
    bar = f'<progress value="{seen.done}" max="{max(seen.total, 1)}"></progress>'
    return f"<p>{escape(seen.headline)} {bar} {seen.done}/{seen.total}, {escape(words)}</p>"
