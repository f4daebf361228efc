"""Charts: the data that the browser draws, and the table behind each."""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.errors import NoisePruned
from eigenfail.filters import Condition, Conditions, Operator, read_value
from eigenfail.presentation import figures
from eigenfail.presentation.analyses import MOST_CHANNELS, pick_channels, rank_channels
from eigenfail.presentation.rates import name_rates
from eigenfail.presentation.tables import (
    Cell,
    FormattedCell,
    Reading,
    Table,
    TableColumn,
    format_cell,
    name_columns,
    read_number,
    read_text,
    tabulate,
)
from eigenfail.values.arrays import Floats
from eigenfail.values.campaign import Campaign
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.estimates import Rate
from eigenfail.values.records import EpisodeRow
from eigenfail.values.summary import Course, CourseBlock, EpisodeSample
from eigenfail_services.statistics.importance import expected_log_probability
from eigenfail_services.store.store import Store

# The table stands for a chart where scripts are off; the files of a campaign hold all rows.
MOST_ROWS = 200


Row = Sequence[Cell]


class ChartTable(NamedTuple):
    """The values behind a chart, for readers without scripts.

    Attributes:
        titles: titles of the columns, each with its unit.
        rows: a cell for each column.
        notes: sentences on what the table leaves out.
    """

    titles: Sequence[str]
    rows: Sequence[Row]
    notes: tuple[str, ...] = ()

    @property
    def columns(self) -> tuple[TableColumn, ...]:
        """Return the columns; each holds text."""
        return name_columns(*self.titles)

    @property
    def cells(self) -> tuple[tuple[FormattedCell, ...], ...]:
        """Return the rows as text."""
        return tuple(tuple(map(format_cell, row)) for row in self.rows)


class Chart(msgspec.Struct, frozen=True, kw_only=True):
    """A chart for the browser, and its text for browsers without scripts.

    Attributes:
        id: id of its element on the page.
        kind: name of the module that draws it.
        title: title of the chart.
        caption: how to read it, in a sentence.
        data: data for the module; plain JSON, and arrays, which the page rounds.
        table: the same numbers, for readers without scripts; its notes describe omissions.
        every: the table of all channels. It is given if the chart and its table show only the most
            influential channels.
    """

    id: str
    kind: str
    title: str
    caption: str
    data: dict[str, object]
    table: Table | ChartTable
    every: ChartTable | None = None

    @property
    def channels(self) -> int:
        """Return the number of channels that can be drawn, the most influential ones first."""
        channels = self.data.get("channels")
        return len(channels) if isinstance(channels, dict) else 0

    @property
    def first_channel_count(self) -> int:
        """Return the number of channels that are drawn until a user wants all of them."""
        return min(self.channels, MOST_CHANNELS)


class ChannelPlot(NamedTuple):
    """Values of several channels of noise. A page shows the most influential channels first.

    Attributes:
        channels: names of the channels.
        weights: values that rank the channels, as `pick_channels` takes them.
        draw: returns the browser's data for the channels in the given columns of the noise.
        tabulate: returns the table of the channels in the given columns.
    """

    channels: Sequence[str]
    weights: Floats
    draw: Callable[[Sequence[int]], dict[str, object]]
    tabulate: Callable[[Sequence[int]], ChartTable]

    def make_chart(self, name: str, kind: str, title: str, caption: str, why: str) -> Chart:
        """Return the chart; its caption says why some channels are shown first."""
        shown = ranked = pick_channels(self.weights)
        table = every = self.tabulate(shown)
        if len(shown) < len(self.channels):
            ranked = rank_channels(self.weights)
            every = self.tabulate(ranked)
            of_all = f"{len(shown)} of {len(self.channels)} channels"
            caption = f"{caption} The {of_all} with {why} are shown first."
        return Chart(
            id=name,
            kind=kind,
            title=title,
            caption=caption,
            data=self.draw(ranked),
            table=table,
            every=None if every is table else every,
        )


def note_the_first(count: int) -> tuple[str, ...]:
    """Return the note of a table that leaves rows out; none if it has all `count` rows."""
    return (f"The first {MOST_ROWS} of {count} rows.",) if count > MOST_ROWS else ()


def tabulate_first(rows: Sequence[object], *readings: Reading) -> Table:
    """Return the table of the first rows, with a note if there are more."""
    return tabulate("", rows[:MOST_ROWS], *readings, notes=note_the_first(len(rows)))


def collect_floats(values: Iterable[float | None]) -> NDArray[np.float64]:
    """Return the values of a line as an array, which the page rounds; NaN for a missing one."""
    return np.array(list(values), np.float64)


DISTANCES = "Smallest distance between footprints in each episode [m];"
ANSWERS = (
    "In each episode the robustness of the requirements ÷ their scale, or the function's answer, 0 "
    "where it is less;"
)


CHOSEN = " that the method chose, which is no failure rate under p(x)"


def make_curve_chart(course: Course, unit: str = "m") -> Chart:
    """Return the chart of the failure rate, or share of failures, over the course of a campaign.

    Args:
        course: blocks of its episodes.
        unit: unit of robustness; empty for a function.
    """
    blocks = course.blocks
    what = name_rates(block.failure_rate for block in blocks)
    # An interval of the episodes that a search chose would say nothing of p(x).
    is_sampled = all(block.failure_rate.sampled for block in blocks)
    basis = ", with 95 % intervals" if is_sampled else CHOSEN
    bounds = [block.failure_rate.interval for block in blocks]
    return Chart(
        id="curve-chart",
        kind="curve",
        title=course.heading,
        caption=(
            f"{what} by blocks of {figures.count_noun(course.per, 'episode')}{basis}; "
            "the table holds likelihood and robustness, too."
        ),
        data={
            "what": what,
            # The rate of a block is drawn at its middle, since it holds for all of its episodes.
            "middle": [(block.first + block.last) / 2.0 for block in blocks],
            "span": [format_span(block) for block in blocks],
            "rate": collect_floats(100.0 * block.failure_rate.share for block in blocks),
            "low": collect_floats(None if each is None else 100.0 * each.low for each in bounds),
            "high": collect_floats(None if each is None else 100.0 * each.high for each in bounds),
        },
        table=tabulate(
            "",
            blocks,
            read_text("Episodes", format_span),
            read_number("Failures", "failure_rate.k"),
            read_number("Completed", "failure_rate.n"),
            read_number(what, "failure_rate.value", "share"),
            read_text("95 % interval", lambda block: format_bounds(block.failure_rate)),
            read_number("log p per step of the failures", "log_probability_per_step"),
            read_number("Median robustness", "median_robustness_m", unit),
        ),
    )


def format_bounds(rate: Rate) -> str:
    """Return the interval of a failure rate, or a dash for the episodes of a search."""
    return (
        figures.UNKNOWN if rate.interval is None else figures.format_percent_interval(rate.interval)
    )


def format_span(block: CourseBlock) -> str:
    """Return the first and the last episode of a block as text."""
    return f"{block.first} – {block.last}"


def make_robustness_chart(
    rows: Sequence[EpisodeRow | EpisodeSample],
    course: Course,
    ended: int,
    unit: str = "m",
) -> Chart:
    """Return the chart of each episode's smallest distance to another vehicle.

    If the unit is empty, the chart shows the robustness of requirements, or a function's answers.
    """
    # An episode that errored measured nothing.
    measured = [row for row in rows if row.robustness_m is not None]
    counts = f"{figures.format_count(len(rows))} of {figures.format_count(ended)}"
    sample = f"A sample of {counts}." if len(rows) < ended else ""
    return Chart(
        id="robustness-chart",
        kind="robustness",
        title="Robustness",
        caption=f"{DISTANCES if unit else ANSWERS} 0 is a failure. {sample}",
        data={
            "index": [row.index for row in measured],
            "robustness": collect_floats(row.robustness_m for row in measured),
            "failure": [row.outcome.is_failure for row in measured],
            "unit": unit,
        },
        table=tabulate(
            "",
            course.blocks,
            read_text("Episodes", format_span),
            read_number("Completed", "failure_rate.n"),
            read_number("Smallest", "smallest_robustness_m", unit),
            read_number("Median", "median_robustness_m", unit),
            notes=("By blocks of episodes; each episode is in the API.",),
        ),
    )


AXES = {
    "robustness_m": "Robustness",
    "log_probability_per_step": "log p per step",
    "severity": "Severity [m²/s²]",
    "min_ttc_s": "MinTTC [s]",
    "max_drac_mps2": "DRAC [m/s²]",
    "steps": "Steps",
}


def make_parallel_chart(rows: Sequence[EpisodeRow], unit: str, *, is_all: bool) -> Chart:
    """Return the parallel-coordinates chart, with a line for each episode.

    Args:
        rows: the episodes.
        unit: unit of robustness; empty for a function or requirements.
        is_all: whether they are all episodes that match the filter.
    """

    def read(name: str, row: EpisodeRow) -> float | None:
        value = read_value(row, name)
        return None if value is None else float(value)

    readers = {name: partial(read, name) for name in AXES}
    titles = AXES | ({"robustness_m": f"Robustness [{unit}]"} if unit else {})
    count = figures.format_count(len(rows))
    coverage = f"A sample of {count} of the episodes that match."
    if is_all:
        coverage = f"All {count} episodes that match."
    if is_all and len(rows) == 1:
        coverage = "The only episode that matches."
    return Chart(
        id="parallel-chart",
        kind="parallel",
        title="Parallel coordinates",
        caption=(
            f"{coverage} One line each. Draw along an axis to "
            "narrow the list below: it becomes a condition of the filter."
        ),
        data={
            "columns": list(AXES),
            "names": list(titles.values()),
            "values": [collect_floats(map(read, rows)) for read in readers.values()],
            "failure": [row.outcome.is_failure for row in rows],
        },
        table=tabulate_first(
            rows,
            read_text("Episode", lambda row: str(row.index)),
            read_text("Outcome", "outcome.word"),
            *(read_number(titles[name], read) for name, read in readers.items()),
        ),
    )


LINES = 2_000
"""Episodes that a chart draws at most: more lines cannot be told apart."""

STRETCHES = 40
"""Parts of a campaign that a sample is drawn from."""


class Spread(NamedTuple):
    """Episodes that match some conditions: all of them, or a sample."""

    rows: tuple[EpisodeRow, ...]
    is_all: bool


def spread(
    store: Store, campaign: Campaign, where: Conditions = (), most: int | None = None
) -> Spread:
    """Return all matching episodes or, if there are too many, the first ones of even intervals.

    Args:
        store: store of the episodes.
        campaign: campaign of the episodes.
        where: conditions that the episodes must match.
        most: largest number of episodes; None: as many as a chart draws.
    """
    most = LINES if most is None else most
    page = store.episodes.page(campaign.id, most, None, where)
    if page.next is None:
        return Spread(page.items, is_all=True)
    # A method that learns fails more often later on: the first episodes alone would mislead.
    reach, each = campaign.counts.completed + campaign.counts.errored, most // STRETCHES
    rows: list[EpisodeRow] = []
    for stretch in range(STRETCHES):
        first, last = (reach * n // STRETCHES for n in (stretch, stretch + 1))
        within = (
            Condition("index", Operator.AT_LEAST, first),
            Condition("index", Operator.BELOW, last),
        )
        rows += store.episodes.page(campaign.id, each, None, (*where, *within)).items
    return Spread(tuple(rows), is_all=False)


MOST_FAILURES = 8
"""Sigma follows the course of an episode, which differs little between failures."""


class PriorReference(msgspec.Struct, frozen=True):
    """log p per step that other noise has over the steps of some failures, at their sigma.

    Attributes:
        typical: average log p of noise drawn from p(x). [nats]
        none: log p of no noise at all, the largest possible value. [nats]
        failures: number of failures that were considered.
    """

    typical: float
    none: float
    failures: int


def find_reference(store: Store, campaign: int, failures: Iterable[int]) -> PriorReference | None:
    """Return the reference over the steps of failures; None without any, or if pruned."""
    indices = tuple(failures)
    try:
        # An open page asks again and again for the same failures, whose noise never changes.
        return store.answers.get(
            ("reference", campaign), indices, lambda: read_reference(store, campaign, indices)
        )
    except NoisePruned:
        return None


def read_reference(store: Store, campaign: int, failures: Iterable[int]) -> PriorReference | None:
    """Return the same reference, computed from the stored noise.

    Raises:
        NoisePruned: the noise is not stored any more.
    """
    found = store.episodes.finished(campaign, failures)
    return make_reference([result.noise for result in found if result.steps])


def make_reference(noises: list[NoiseTrajectory]) -> PriorReference | None:
    """Return the reference over the steps of noise trajectories; None for no trajectory."""
    # Weighted by steps, as log p per step of the failures is.
    steps = sum(len(noise.z) for noise in noises)
    if not steps:
        return None
    silent = (NoiseTrajectory(np.zeros_like(each.z), each.sigma, each.shape) for each in noises)
    return PriorReference(
        typical=sum(map(expected_log_probability, noises)) / steps,
        none=sum(noise.log_probability for noise in silent) / steps,
        failures=len(noises),
    )
