"""The page on which episodes are found."""

import shlex
from urllib.parse import urlencode

import msgspec

from eigenfail.filters import BY_INDEX, COLUMNS, Column, Sort
from eigenfail.filters.parser import LONGEST
from eigenfail.values import Campaign, Page
from eigenfail.values.records import EpisodeRow
from eigenfail.wire.http import PREFIX
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.charts import Chart
from eigenfail_api.dashboard.views.lists import (
    EpisodeLine,
    Heading,
    address,
    episode_line,
    headings,
    may_grow,
    order,
)

EXAMPLES = {
    "outcome = collision and severity > 80": "hard collisions",
    "class = planner_failure and ttc_lead_s > 1": "braking in time would have helped",
    "class = near_miss and source != prior": "what the search came close to",
    "outcome = failed": "episodes that could not be run",
}


class Example(msgspec.Struct, frozen=True):
    """A filter to begin with."""

    filter: str
    address: str
    words: str


class Asked(msgspec.Struct, frozen=True):
    """What stands in the address of the page."""

    filter: str
    sort: Sort
    after: int | None = None


class FoundView(msgspec.Struct, frozen=True, kw_only=True):
    """The page.

    Attributes:
        problem: what is wrong with the filter, in words; empty if nothing is.
        chart: None where nothing was found.
        title: how many are shown of what.
        sorted: by what, in words.
        command: that exports the same as Parquet.
        exports: links to files of the same episodes.
        first: the first page; empty on it.
        next: the page behind this one; empty on the last.
        empty: why there is nothing to see.
    """

    campaign: int
    name: str
    filter: str
    sort: str
    sorted: str
    longest: int = LONGEST
    problem: str = ""
    examples: tuple[Example, ...]
    columns: tuple[Column, ...]
    chart: Chart | None = None
    title: str
    command: str = ""
    exports: tuple[tuple[str, str], ...] = ()
    headings: tuple[Heading, ...] = ()
    lines: tuple[EpisodeLine, ...] = ()
    per_page: int = 0
    first: str = ""
    next: str = ""
    empty: str = ""


def found_view(
    campaign: Campaign, asked: Asked, page: Page[EpisodeRow], chart: Chart | None
) -> FoundView:
    """The page of what was found."""
    here, conditions, sort = campaign.id, asked.filter, str(asked.sort)
    return msgspec.structs.replace(
        blank(campaign, asked),
        chart=chart,
        title=title(page, asked),
        command=command(here, asked),
        exports=exports(here, asked),
        headings=headings(here, conditions, asked.sort),
        lines=tuple(map(episode_line, page.items)),
        per_page=len(page.items),
        first="" if asked.after is None else address(here, conditions, sort),
        next="" if page.next is None else address(here, conditions, sort, page.next),
        empty=nothing(campaign, asked),
    )


def refused_view(campaign: Campaign, asked: Asked, problem: str) -> FoundView:
    """The page where the filter cannot be read."""
    empty = "Nothing was looked for: the filter cannot be read."
    return msgspec.structs.replace(blank(campaign, asked), problem=problem, empty=empty)


def blank(campaign: Campaign, asked: Asked) -> FoundView:
    """The page before anything is looked for."""
    return FoundView(
        campaign=campaign.id,
        name=campaign.spec.name,
        filter=asked.filter,
        sort=str(asked.sort),
        sorted=f"{asked.sort.column}, {order(asked.sort)}",
        examples=tuple(
            Example(text, address(campaign.id, text), words) for text, words in EXAMPLES.items()
        ),
        columns=tuple(COLUMNS.values()),
        title="Episodes",
    )


def title(page: Page[EpisodeRow], asked: Asked) -> str:
    """How many are shown, and whether these are all."""
    shown = len(page.items)
    if page.next is None and asked.after is None:
        return formats.counted(shown, "episode")
    if asked.after is not None:
        return formats.counted(shown, "further episode")
    return f"The first {shown} episodes"


def nothing(campaign: Campaign, asked: Asked) -> str:
    """Why the list is empty."""
    if asked.after is not None:
        return "There are no further episodes."
    if asked.filter:
        return "No episode matches the filter."
    return "No episode has ended yet." if may_grow(campaign) else "No episode was run."


def exports(campaign: int, asked: Asked) -> tuple[tuple[str, str], ...]:
    """Where the same episodes are as files."""
    query = urlencode({"filter": asked.filter, "sort": str(asked.sort)})
    path = f"{PREFIX}/campaigns/{campaign}/episodes"
    return tuple((word, f"{path}.{word.lower()}?{query}") for word in ("CSV", "NDJSON"))


def command(campaign: int, asked: Asked) -> str:
    """The command that writes the same episodes as Parquet."""
    words = ["eigenfail", "episode", "export", str(campaign), "-o", "episodes.parquet"]
    words += ["--filter", asked.filter] if asked.filter else []
    words += ["--sort", str(asked.sort)] if asked.sort != BY_INDEX else []
    return shlex.join(words)
