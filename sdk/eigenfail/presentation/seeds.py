"""Tables of campaigns over seeds: mean, spread, and the cost of a failure with its interval."""

from collections.abc import Callable, Iterator, Sequence

from eigenfail.presentation import figures, tables
from eigenfail.presentation.rates import FAILED_SHARE
from eigenfail.values.estimates import Interval
from eigenfail.values.seeds import FirstFailures, SeedFigure, SeedSpread

OVER_SEEDS = "Over seeds"
SHARE = FAILED_SHARE
MEAN_OF = "[95 % interval of the mean]"
NO_INTERVAL = "These seeds give no interval of the cost per failure."
OPEN_ABOVE = (
    "The number of failures varies so much between these seeds that the cost per failure has a "
    "lower bound alone (97.5 %)."
)

Format = Callable[[float], str]


def label_spread(spread: SeedSpread, is_only: bool) -> str:
    """Return the name of a row that holds means over seeds.

    Args:
        spread: the campaigns.
        is_only: whether it is the only group; otherwise the label begins with the group's name.
    """
    kind = "mean over" if spread.pooled is None else "rate of all episodes, means over"
    words = f"{kind} {figures.count_noun(len(spread.seeds), 'seed')}"
    return words if is_only else f"{spread.name}: {words}"


def list_spread(spread: SeedSpread) -> tuple[tables.Cell, ...]:
    """Return the cells of means over seeds in the columns of a campaign's results."""
    return (
        spread.completed,
        spread.failures,
        # The mean over seeds of a random sample has a wider interval, or none where all are equal.
        spread.pooled or _format_mean(spread.share, figures.format_share, _format_share_interval),
        _format_mean(
            spread.log_probability_per_step, figures.format_number, figures.format_interval
        ),
        _format_mean(spread.mean_severity, figures.format_number, figures.format_interval),
        None,
        spread.cost,
    )


def tabulate_spreads(spreads: Sequence[SeedSpread]) -> tables.Table:
    """Return mean, spread, median and range of each figure, one a row, group by group.

    The row of the share of failures also names the seed with the fewest failures.
    """
    is_only = len(spreads) == 1
    over = figures.count_noun(len(spreads[0].seeds), "seed") if is_only else "seeds"
    columns = (
        *tables.name_columns(*([] if is_only else ["Group"]), OVER_SEEDS),
        *tables.count_columns(f"Mean over {over} [95 %]", "Std dev", "Smallest"),
        *tables.count_columns("Median", "Largest", "Seed with fewest"),
    )
    rows = tuple(
        row
        if is_only
        else (f"{spread.name}, {figures.count_noun(len(spread.seeds), 'seed')}", *row)
        for spread in spreads
        for row in _list_rows(spread)
    )
    remarks = (
        sentence if is_only else f"{spread.name}: {sentence}"
        for spread in spreads
        for sentence in list_remarks(spread)
    )
    # A note on a pooled rate holds for its group alone; all others are given once.
    shared = tables.list_notes(
        spread.notes if is_only or spread.pooled is None else _name_group(spread)
        for spread in spreads
    )
    return tables.Table(OVER_SEEDS, columns, rows, (*remarks, *shared))


def _name_group(spread: SeedSpread) -> tuple[str, ...]:
    """Return the notes of a group, each after the group's name, since they state a pooled rate."""
    return tuple(f"{spread.name}: {note}" for note in spread.notes)


def _list_rows(spread: SeedSpread) -> Iterator[tuple[tables.Cell, ...]]:
    worst = tables.FormattedCell(
        f"{spread.worst.seed}", sample=figures.format_share(spread.worst.value)
    )
    yield (
        SHARE,
        _format_mean(spread.share, figures.format_share, _format_share_interval),
        *_list_extremes(spread.share, figures.format_share),
        None if spread.share.is_constant else worst,
    )
    for name, figure in (
        ("log p/step of the failures [nats]", spread.log_probability_per_step),
        ("Severity of the collisions [m²/s²]", spread.mean_severity),
    ):
        yield (
            name,
            _format_mean(figure, figures.format_number, figures.format_interval),
            *_list_extremes(figure, figures.format_number),
            None,
        )
    # No mean: seeds without a failure are known only to need more episodes than they had.
    yield ("Episodes to the first failure", None, None, None, *_list_first(spread.first))
    yield ("Cost per failure, total ÷ all [USD]", spread.cost, None, None, None, None, None)


def _list_extremes(figure: SeedFigure | None, write: Format) -> tuple[tables.Cell, ...]:
    if figure is None:
        return (None, None, None, None)
    deviation = figures.UNKNOWN if figure.deviation is None else write(figure.deviation)
    return (deviation, *map(write, (figure.least, figure.median, figure.most)))


def _list_first(found: FirstFailures) -> tuple[tables.Cell, ...]:
    """Return the median, the largest number, and the seed with the largest number."""
    none = f"none in {figures.count_noun(found.within, 'episode')}"
    largest = none if found.worst is None else figures.format_count(found.worst)
    median = figures.UNKNOWN if found.median is None else f"{found.median:,g}"
    return (median, largest, tables.FormattedCell(str(found.worst_seed), sample="latest"))


def _format_mean(
    figure: SeedFigure | None, write: Format, write_interval: Callable[[Interval], str]
) -> tables.FormattedCell:
    if figure is None:
        return tables.FormattedCell(figures.UNKNOWN)
    value = write(figure.mean)
    if figure.interval is not None:
        return tables.FormattedCell(value, write_interval(figure.interval))
    same = f"the same for {figures.count_noun(figure.n, 'seed')}" if figure.is_constant else ""
    return tables.FormattedCell(value, sample=same)


def _format_share_interval(interval: Interval) -> str:
    return figures.format_interval(interval, 100.0)


def list_remarks(spread: SeedSpread) -> Iterator[str]:
    """Yield the mean share in a sentence, and remarks on the seeds."""
    yield _describe_share(spread)
    figure, first = spread.log_probability_per_step, spread.first
    # If no seed found a failure, the sentence on the cost says so.
    if first.without and first.without < len(spread.seeds):
        yield (
            f"Seeds without a failure, {first.without} of {len(spread.seeds)}, count in the share, "
            "in the first failure and in the cost per failure"
            f"{'' if figure is None else f'; log p and severity are of the other {figure.n}'}."
        )
    yield from _describe_cost(spread)


def _describe_share(spread: SeedSpread) -> str:
    share, seeds = spread.share, figures.count_noun(len(spread.seeds), "seed")
    if share.interval is not None:
        mean = _format_mean(share, figures.format_share, _format_share_interval).line
        return (
            f"{SHARE}, mean over {seeds} {MEAN_OF}: {mean}; median "
            f"{figures.format_share(share.median)}, fewest "
            f"{figures.format_share(spread.worst.value)}, with seed {spread.worst.seed}."
        )
    if share.is_constant:
        return (
            f"{SHARE}: {figures.format_share(share.mean)} with each of {seeds}. Equal values show "
            "no spread, so that there is no interval of the mean."
        )
    return f"{SHARE}: {figures.format_share(share.mean)} with one seed, which shows no spread."


def _describe_cost(spread: SeedSpread) -> Iterator[str]:
    cost = spread.cost
    if not spread.failures and cost.at_least_usd is not None:
        yield "No seed found a failure: the cost per failure is a lower bound (95 %)."
    # One seed shows no spread: that it gives no interval goes without saying.
    elif spread.failures and cost.interval_usd is None and len(spread.seeds) > 1:
        yield NO_INTERVAL if cost.at_least_usd is None else OPEN_ABOVE
