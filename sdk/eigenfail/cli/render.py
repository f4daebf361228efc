"""The output of commands: JSON for programs, tables for people; with `--watch`, again and again."""

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any, Generic, TypeVar

import msgspec
import numpy as np
import typer
from rich.console import Console, RenderableType
from rich.live import Live

from eigenfail.client import Client
from eigenfail.client.campaigns import AT_REST
from eigenfail.client.link import wait_until
from eigenfail.errors import Conflict, EigenfailError, IllegalTransition, ServiceError
from eigenfail.hosting.processes import interruptible
from eigenfail.presentation.analyses import describe_chain_mixing
from eigenfail.presentation.episodes import describe_minimal_failure
from eigenfail.presentation.figures import count_noun
from eigenfail.presentation.tables import Block, Table
from eigenfail.presentation.terminal import render
from eigenfail.progress import (
    PlainLines,
    Standing,
    display,
    format_headline,
    make_standing,
    reporter,
)
from eigenfail.suites import Suite
from eigenfail.values.campaign import FINAL_STATES, Campaign, CampaignState, Counts
from eigenfail.values.summary import Errored, Summary

PLAIN_WIDTH = 1_000
"""Of pipes and files: no row is broken there. [characters]"""


Row = TypeVar("Row")


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


# A pipe has no width. Programs read a row as a line, and all columns of it.
def make_console() -> Console:
    """Return the console for tables; wide enough for one line a row if it is not a terminal."""
    screen = Console(highlight=False)
    return screen if screen.is_terminal else Console(highlight=False, width=PLAIN_WIDTH)


def show(value: object, as_json: bool, *document: Block) -> None:
    """Print a value as JSON, or for people as tables and texts."""
    if as_json:
        typer.echo(to_json(value))
        return
    # The terminal breaks a single text itself, so that a key or digest in it is copied whole.
    is_text = len(document) == 1 and isinstance(document[0], str)
    make_console().print(render(*document), soft_wrap=is_text)


class CommandResult:
    """The findings of a command.

    Args:
        data: what `--json` prints.
        document: the same for people.
        exit_code: exit code of the command.
    """

    def __init__(self, data: object, *document: Block, exit_code: int = 0) -> None:
        self._data = data
        self._document = document
        self.exit_code = exit_code

    def print(self, as_json: bool) -> None:
        """Print the result as JSON, or as tables and texts."""
        show(self._data, as_json, *self._document)


def first_rows(
    rows: Iterable[Row], limit: int, tabulate: Callable[[Sequence[Row]], Table]
) -> CommandResult:
    """Return the first rows, as a table that says whether there are more."""
    # One row more than is shown tells whether there are more: a list may have thousands.
    found = list(islice(rows, limit + 1))
    shown = found[:limit]
    words = f"The first {limit}; there are more. Show more with --limit."
    more = (words,) if len(found) > limit else ()
    return CommandResult(shown, tabulate(shown), *more)


Snapshot = TypeVar("Snapshot")


POLL_S = 1.0


@dataclass(frozen=True)
class TerminalView(Generic[Snapshot]):
    """The output of a command.

    Attributes:
        look: fetches the current state.
        campaigns: campaigns of the suite; watching ends once all of them have ended or are paused.
        to_data: makes the data that `--json` prints.
        describe: makes the document for people.
        watched: whether it is printed until all campaigns are at rest, not once.
    """

    look: Callable[[], Snapshot]
    campaigns: Callable[[Snapshot], Iterable[Campaign]]
    to_data: Callable[[Snapshot], object]
    describe: Callable[[Snapshot], Iterable[Block]]
    watched: bool
    exit_code: int = 0

    def print(self, as_json: bool) -> None:
        """Print the snapshot once, or watch the campaigns."""
        with interruptible():
            if self.watched:
                self.watch(as_json)
                return
            seen = self.look()
            # The document may take further requests, which JSON does without.
            document = () if as_json else self.describe(seen)
            show(self.to_data(seen), as_json, *document)

    def watch(self, as_json: bool) -> None:
        """Show it again and again: in one place of a terminal, elsewhere what has changed."""
        screen = make_console()
        if as_json:
            self.until_rest(_JsonChanges(self.to_data))
        elif screen.is_terminal:
            with Live(console=screen, auto_refresh=False) as live:
                self.until_rest(lambda seen: live.update(self._draw(seen), refresh=True))
        else:
            screen.print(self._draw(self.until_rest(_ProgressLines(self.campaigns))))

    def _draw(self, seen: Snapshot) -> RenderableType:
        return render(*self.describe(seen))

    def until_rest(self, tell: Callable[[Snapshot], None]) -> Snapshot:
        """Return the last snapshot, at which all campaigns are at rest; report every snapshot."""

        def look() -> Snapshot:
            seen = self.look()
            tell(seen)
            return seen

        def at_rest(seen: Snapshot) -> bool:
            return all(campaign.state in AT_REST for campaign in self.campaigns(seen))

        return wait_until(look, at_rest, POLL_S, None)


class _JsonChanges(Generic[Snapshot]):
    """Prints it as JSON on one line, whenever it is not what it was."""

    def __init__(self, to_data: Callable[[Snapshot], object]) -> None:
        self.to_data = to_data
        self.last = ""

    def __call__(self, seen: Snapshot) -> None:
        """Print it, if it has changed."""
        now = to_json(self.to_data(seen), indent=0)
        # Programs read a line for each change; the same line each second would be no news.
        if now != self.last:
            typer.echo(now)
        self.last = now


class _ProgressLines(Generic[Snapshot]):
    """Prints a line for each campaign whenever its state changes, and now and then."""

    def __init__(self, campaigns: Callable[[Snapshot], Iterable[Campaign]]) -> None:
        self.campaigns = campaigns
        self.lines: dict[int, PlainLines] = {}

    def __call__(self, seen: Snapshot) -> None:
        """Print the lines that are due."""
        for campaign in self.campaigns(seen):
            self.lines.setdefault(campaign.id, PlainLines(typer.echo))(make_standing(campaign))


PATIENCE_S = 5.0
"""Of a campaign that gets on so often nothing is asked."""


def find_missing_workers(client: Client, campaign: Campaign) -> tuple[str, ...]:
    """Which worker a campaign waits for; nothing if one is there, or if it is not known."""
    if campaign.state != CampaignState.RUNNING:
        return ()
    try:
        stranded = client.staffing().stranded
    except EigenfailError:
        return ()
    return tuple(event.message for event in stranded if event.campaign == campaign.id)


class _MissingWorkerNotice:
    """Says on standard error what a campaign lacks, once, if it does not get on.

    Args:
        client: client of the service that runs it.
    """

    def __init__(self, client: Client) -> None:
        self._client = client
        self._done = -1
        self._next_s = 0.0
        self._said: tuple[str, ...] = ()

    def __call__(self, seen: Campaign) -> None:
        """Look, if nothing came for a while."""
        now_s, done = time.monotonic(), seen.counts.completed + seen.counts.errored
        # Asked only if nothing comes: a campaign that gets on has its workers.
        if done == self._done and now_s < self._next_s:
            return
        if done == self._done:
            self._say(find_missing_workers(self._client, seen))
        self._done, self._next_s = done, now_s + PATIENCE_S

    def _say(self, words: tuple[str, ...]) -> None:
        if words and words != self._said:
            typer.echo("\n".join(words), err=True)
        self._said = words


def skip_check() -> None:
    """Check nothing, for a service that another process manages."""


def follow(client: Client, campaign: int, check: Callable[[], None] = skip_check) -> Campaign:
    """Show the campaign's progress until it has ended or is paused.

    Args:
        client: client of the service that runs it.
        campaign: its id.
        check: raises if the service is in trouble.
    """
    lookout = _MissingWorkerNotice(client)
    with reporter() as report:

        def look(seen: Campaign) -> None:
            check()
            report(seen)
            lookout(seen)

        ended = client.campaigns.wait(campaign, look)
    if ended.state is CampaignState.DONE:
        typer.echo(f"{format_headline(ended)}: {ended.stopped_because}", err=True)
    return ended


# Rounds that take longer go on pausing behind the command: Ctrl-C must not seem to hang.
PAUSE_WITHIN_S = 15.0


INTERRUPTED = 130


def follow_or_pause(
    client: Client, campaign: int, check: Callable[[], None] = skip_check, again: str = ""
) -> Campaign:
    """Follow a campaign to its end; on Ctrl-C pause it, say how to go on, and exit with 130.

    Args:
        client: client of the service that runs it.
        campaign: its id.
        check: raises if the service is in trouble.
        again: the command that starts the service again, if it ends with this command.
    """
    try:
        return follow(client, campaign, check)
    except KeyboardInterrupt:
        try:
            client.campaigns.pause(campaign)
            seen = client.campaigns.wait(campaign, timeout_s=PAUSE_WITHIN_S)
        except (IllegalTransition, ServiceError):  # it ended first, or is still pausing
            seen = client.campaigns.get(campaign)
        counts = seen.counts
        done = f"{counts.completed + counts.errored} of {counts.planned} episodes"
        words = f"Campaign {campaign} is {seen.state} after {done}."
        if seen.state not in FINAL_STATES:
            first = f"start the service with '{again}', then " if again else ""
            words += f" To continue: {first}eigenfail campaign resume {campaign}"
        typer.echo(words, err=True)
        raise typer.Exit(INTERRUPTED) from None


Snapshots = Sequence[Campaign | None]


def run_suite(
    client: Client, suite: Suite, check: Callable[[], None], command: str
) -> tuple[Campaign, ...]:
    """Start missing and paused campaigns, and follow all of them to their end.

    On Ctrl-C all of it is paused, the way on is said, and the exit code is 130.

    Args:
        client: client of the service that runs it.
        suite: the campaigns.
        check: raises if the service is in trouble.
        command: what goes on with it.
    """
    try:
        # Progress goes to standard error, so that standard output holds results alone.
        with display() as report:

            def look(seen: Snapshots) -> None:
                check()
                report(_summarize_suite(suite.name, seen))

            ended = client.suites.run(suite, look)
    except KeyboardInterrupt:
        try:
            client.suites.pause(suite)
            seen = client.suites.wait(suite, timeout_s=PAUSE_WITHIN_S)
        except ServiceError:  # some are still pausing
            seen = client.suites.find(suite)
        typer.echo(f"{describe_suite(suite.name, seen)}. To continue: {command}", err=True)
        raise typer.Exit(INTERRUPTED) from None
    return tuple(campaign for campaign in ended if campaign is not None)


def _summarize_suite(name: str, seen: Snapshots) -> Standing:
    """How far they are together."""
    counts = _sum_counts(seen)
    done, total = counts.completed + counts.errored, counts.planned - counts.cancelled
    return Standing(_describe_suite_state(name, seen), done, total, counts.failures, counts.errored)


def describe_suite(name: str, seen: Snapshots) -> str:
    """How far they came."""
    counts = _sum_counts(seen)
    done = counts.completed + counts.errored
    episodes = count_noun(counts.planned - counts.cancelled, "episode")
    failures = count_noun(counts.failures, "failure")
    errored = f", {counts.errored} errored" if counts.errored else ""
    return f"{_describe_suite_state(name, seen)}: {done}/{episodes}, {failures}{errored}"


def _describe_suite_state(name: str, seen: Snapshots) -> str:
    """How many of them are at rest."""
    resting = [campaign for campaign in seen if campaign and campaign.state in AT_REST]
    paused = sum(campaign.state == "paused" for campaign in resting)
    rests = f", {paused} paused" if paused else ""
    return f"{name}: {len(resting) - paused} of {count_noun(len(seen), 'campaign')} over{rests}"


def _sum_counts(seen: Snapshots) -> Counts:
    """The episodes of all of them."""
    counts = [campaign.counts for campaign in seen if campaign]
    sums = {name: sum(getattr(each, name) for each in counts) for name in Counts.__struct_fields__}
    return Counts(**sums)


FAILURES_FOUND = 1


def judge(campaign: Campaign, gate: bool, summary: Summary | None = None) -> None:
    """Exit with 1 if a gate was asked for and failures were found.

    Args:
        campaign: campaign that is to be judged.
        gate: whether failures count.
        summary: summary of the campaign, for the reason if all of its episodes errored.

    Raises:
        ServiceError: the campaign came to nothing: it is dead, all of its episodes errored, or the
            service paused it with a reason; or a gate was requested and is inconclusive.
    """
    counts = campaign.counts
    # Nothing was found out, whatever the gate: a pipeline must not take it for a pass.
    if campaign.is_errored:
        raise make_errored_error(campaign, summary)
    if campaign.state is CampaignState.DEAD:
        raise ServiceError(f"Campaign {campaign.id} is dead: {campaign.stopped_because}")
    if campaign.state is CampaignState.PAUSED and campaign.stopped_because:
        raise ServiceError(f"Campaign {campaign.id} is paused. {campaign.stopped_because}")
    # Before the state and doubts below: a failure that was found closes the gate in any case.
    if gate and counts.failures:
        raise typer.Exit(FAILURES_FOUND)
    if gate and campaign.state is not CampaignState.DONE:
        raise ServiceError(
            f"Campaign {campaign.id} is {campaign.state}, so its gate is inconclusive.",
            "Launch a copy of it."
            if campaign.state in FINAL_STATES
            else f"Resume it: eigenfail campaign resume {campaign.id}",
        )
    # After failures: an errored episode may hide one, but one is enough.
    _refuse_doubt(campaign, gate, summary)
    if gate and not counts.completed:
        raise ServiceError(
            f"Campaign {campaign.id} completed no episode, so its gate is inconclusive.",
            f"See why: eigenfail episode list {campaign.id} --outcome errored",
        )


def _refuse_doubt(campaign: Campaign, gate: bool, summary: Summary | None) -> None:
    """Refuse to pass a gate while an episode may hide a failure.

    Raises:
        ServiceError: a gate was requested, and an episode errored, or is unresolved.
    """
    errored = campaign.counts.errored
    unresolved = summary.unresolved.count if summary else 0
    if not gate or not errored + unresolved:
        return
    counts = {"errored": errored, "ended unresolved": unresolved}
    doubtful = [
        f"{count_noun(count, 'episode')} {words}" for words, count in counts.items() if count
    ]
    see = f"eigenfail episode list {campaign.id} --outcome errored"
    raise ServiceError(
        f"Campaign {campaign.id} found no failure, but {' and '.join(doubtful)} and may hide one, "
        "so its gate is inconclusive.",
        f"See why: {see}" if errored else "Give the scenario a longer horizon.",
    )


def make_errored_error(campaign: Campaign, summary: Summary | None) -> ServiceError:
    """Return the error of a campaign without a result, with the reason and where to look."""
    errored = summary.errored if summary else Errored(campaign.counts.errored)
    first = 0 if errored.first is None else errored.first
    return ServiceError(
        f"Campaign {campaign.id}: {errored.words(campaign.counts)}",
        f"Show one episode: eigenfail episode show {campaign.id}/{first}; all of them: "
        f"eigenfail episode list {campaign.id} --outcome errored",
    )


METHOD_RESULTS: dict[str, Callable[[Client, int], tuple[Block, ...]]] = {
    "minimal": lambda client, id_: describe_minimal_failure(client.campaigns.minimal(id_)),
    "chains": lambda client, id_: describe_chain_mixing(client.campaigns.mixing(id_)),
}
"""What campaigns of some methods come to besides their failures."""


def describe_method_result(client: Client, campaign: Campaign) -> tuple[Block, ...]:
    """Return what a campaign came to besides its failures; nothing of most methods."""
    describe = METHOD_RESULTS.get(campaign.spec.method)
    if describe is None:
        return ()
    try:
        return ("", *describe(client, campaign.id))
    except Conflict as error:
        return ("", str(error))
