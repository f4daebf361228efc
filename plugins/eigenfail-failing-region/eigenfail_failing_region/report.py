"""The section of a report on the failing regions of its campaigns."""

from collections.abc import Iterator, Sequence

from eigenfail.errors import InputError
from eigenfail.presentation import tables
from eigenfail.presentation.figures import format_number
from eigenfail.values.campaign import Campaign
from eigenfail_failing_region.campaigns import find_region
from eigenfail_failing_region.values import Region
from eigenfail_services.store.store import Store

WORDS = (
    "Where the scenario's parameters vary from episode to episode or from campaign to campaign, a "
    "small decision tree looks for the parts in which the planner fails more often. It was grown "
    "on one half of the episodes; all figures are of the other half, with intervals of 95 %."
)
COLUMNS = (
    *tables.name_columns("Campaigns"),
    *tables.count_columns("Part"),
    *tables.name_columns("Where"),
    tables.TableColumn("Share of the failures inside", "share"),
    *tables.count_columns("Failures"),
    tables.TableColumn("Failure rate inside", "share"),
    *tables.count_columns("Failed", "Episodes"),
)
BOUNDS = (
    *tables.name_columns("Campaigns"),
    *tables.count_columns("Part"),
    *tables.name_columns("Parameter"),
    *(tables.TableColumn(title) for title in ("Low", "High")),
    *tables.name_columns("Unit"),
)


def describe_regions(store: Store, campaigns: Sequence[Campaign]) -> tuple[tables.Block, ...]:
    """Return a section of a report: one region for each planner in each scenario.

    It is empty if no parameter of their scenarios varies.
    """
    found = [region for region in _find_regions(store, campaigns) if region.parameters]
    if not found:
        return ()
    sentences = (sentence for region in found for sentence in _describe_chance(region))
    parts = tuple(row for region in found for row in _list_boxes(region))
    bounds = tuple(row for region in found for row in _list_bounds(region))
    return (
        WORDS,
        *sentences,
        tables.Table("Parts of the failing region", COLUMNS, parts),
        tables.Table("Their bounds", BOUNDS, bounds),
    )


def _find_regions(store: Store, campaigns: Sequence[Campaign]) -> Iterator[Region]:
    """Yield a region for each planner in each scenario that is installed here."""
    together: dict[tuple[str, ...], list[int]] = {}
    for campaign in campaigns:
        spec = campaign.spec
        together.setdefault((spec.scenario, spec.planner, spec.simulator), []).append(campaign.id)
    for ids in together.values():
        try:
            yield find_region(store, ids)
        except InputError:
            continue


def _list_ids(region: Region) -> str:
    return ", ".join(map(str, region.campaigns))


def _describe_chance(region: Region) -> Iterator[str]:
    """Yield what keeps a region from saying more, or how surely it is one."""
    who = f"Campaigns {_list_ids(region)}"
    found = f"{region.failures:,} failures in {region.episodes:,} episodes"
    yield f"{who}: {', '.join(region.parameters)} vary; {found}."
    if region.p_value is not None:
        p_value = format_number(region.p_value)
        yield f"{who}: chance alone would put this many failures there with p = {p_value}."
    yield from (f"{who}: {note}" for note in (region.problem, *region.warnings) if note)


def _list_boxes(region: Region) -> Iterator[tuple[tables.Cell, ...]]:
    for part, box in enumerate(region.boxes, 1):
        inside = (box.coverage, box.coverage.n)
        counts = (box.precision.k, box.precision.n) if box.precision else (None, None)
        yield (_list_ids(region), part, box.words, *inside, box.precision, *counts)


def _list_bounds(region: Region) -> Iterator[tuple[tables.Cell, ...]]:
    for part, box in enumerate(region.boxes, 1):
        for bound in box.bounds:
            ends = (bound.low, bound.high)
            yield (_list_ids(region), part, bound.parameter, *ends, bound.unit or None)
