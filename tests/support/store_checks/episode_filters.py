"""Checks of how `EpisodeStore` finds episodes: by every column, in every order."""

from collections.abc import Iterator

from msgspec.structs import replace

from eigenfail.filters import (
    BY_INDEX,
    COLUMNS,
    COMPARE,
    Condition,
    Conditions,
    Operator,
    SortOrder,
    Value,
    parse_filter,
    read_value,
)
from eigenfail.testing.examples import CRASH, collision, make_errored_result, result
from eigenfail.values.episode import EpisodeResult
from eigenfail.values.records import EpisodeRow
from eigenfail_services.store.store import Store
from store_checks.conflicts import every_class
from store_checks.examples import deliver, equal, running

WITHOUT_ORDER = (Operator.EQUAL, Operator.UNEQUAL)
MOST_PAGES = 40
ODD = "'; DROP --"


def some_of_everything() -> list[EpisodeResult]:
    """Every class, ties, measures that are missing, odd names."""
    alike = (result(index, measures=None) for index in (47, 48))
    other = result(49, source=ODD, seed=2**62 + 1, wall_s=0.25)
    return [*every_class(), *alike, other, make_errored_result(45, ODD), collision(46, steps=5)]


def filled(store: Store) -> tuple[int, list[EpisodeRow]]:
    """A campaign with some of everything, and its rows in index order."""
    campaign, other, given = running(store, episodes=50), running(store), some_of_everything()
    deliver(store, campaign, *given)
    deliver(store, other, collision(0), result(1))
    rows = list(store.episodes.page(campaign.id, 100).items)
    equal(len(rows), len(given), "Episodes that are kept")
    return campaign.id, rows


def every_condition(rows: list[EpisodeRow]) -> Iterator[Condition]:
    """Every column, by every operator, against every value that it has somewhere."""
    for name, column in COLUMNS.items():
        values: set[Value] = {v for row in rows if (v := read_value(row, name)) is not None}
        for sign in COMPARE if column.is_ordered else WITHOUT_ORDER:
            yield from (Condition(name, sign, value) for value in values)


def filters_by_every_column(store: Store) -> None:
    """A store keeps just the rows that `matches` keeps."""
    campaign, rows = filled(store)
    for condition in every_condition(rows):
        found = [row.index for row in store.episodes.page(campaign, 100, where=(condition,)).items]
        wanted = [row.index for row in rows if condition.holds(row)]
        equal(found, wanted, f"Episodes with {condition}")
        counted = store.episodes.count(campaign, (condition,))
        equal(counted, len(wanted), f"Number of episodes with {condition}")
    nothing = parse_filter("severity > 0 and index > 9000000000000000000")
    equal(store.episodes.page(campaign, 5, where=nothing).items, (), "Episodes of no index")


def sorts_by_every_column(store: Store) -> None:
    """By value, then by index, both in one direction; rows without a value last."""
    campaign, rows = filled(store)
    where = parse_filter("index != 3")
    for sort in every_sort():
        wanted = [row.index for row in in_order(rows, sort) if row.index != 3]
        for limit in (1, 4, 100):
            found = indices(store, campaign, limit, where, sort)
            equal(found, wanted, f"Pages of {limit} by {sort}")


def every_sort() -> Iterator[SortOrder]:
    """Every column that has an order, up and down."""
    for name, column in COLUMNS.items():
        if column.is_ordered:
            yield from (SortOrder(name), SortOrder(name, descending=True))


def in_order(rows: list[EpisodeRow], sort: SortOrder) -> list[EpisodeRow]:
    """The rows as the contract sorts them."""

    def place(row: EpisodeRow) -> tuple[bool, Value, int]:
        value = read_value(row, sort.column)
        missing = value is None
        return missing is not sort.descending, 0 if value is None else value, row.index

    return sorted(rows, key=place, reverse=sort.descending)


def indices(
    store: Store, campaign: int, limit: int, where: Conditions, sort: SortOrder
) -> list[int]:
    """The indices on all pages."""
    found: list[int] = []
    after: int | None = None
    for _ in range(MOST_PAGES):
        page = store.episodes.page(campaign, limit, after, where, sort)
        found += [row.index for row in page.items]
        after = page.next
        if after is None:
            break
    return found


def loses_no_row_while_others_come_in(store: Store) -> None:
    """What was there when the first page was read is told once, whatever is delivered between."""
    for sort in (
        BY_INDEX,
        SortOrder("severity"),
        SortOrder("severity", descending=True),
        SortOrder("steps"),
    ):
        campaign = running(store, episodes=40)
        early = [(collision if index % 4 else result)(index) for index in range(0, 40, 2)]
        deliver(store, campaign, *early)
        found: list[int] = []
        after: int | None = None
        for late in range(1, 40, 2):
            page = store.episodes.page(campaign.id, 2, after, (), sort)
            found += [row.index for row in page.items]
            worst = replace(CRASH, severity=late / 8)
            deliver(store, campaign, collision(late, measures=worst))
            if (after := page.next) is None:
                break
        equal(len(found), len(set(found)), f"Rows told once by {sort}, of all that were told,")
        missed = {each.index for each in early} - set(found)
        equal(missed, set(), f"Rows that were there, and were not told by {sort}")


def knows_no_place_without_a_result(store: Store) -> None:
    """In any order but that of indices, nothing comes behind an episode that has no result."""
    campaign, _ = filled(store)
    for sort in (SortOrder("severity"), SortOrder("steps", descending=True)):
        page = store.episodes.page(campaign, 10, 29, (), sort)
        equal((page.items, page.next), ((), None), f"Rows behind no place by {sort}")
