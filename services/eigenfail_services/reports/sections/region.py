"""Where among a scenario's parameters the planner fails."""

from collections.abc import Iterator

from eigenfail.errors import InputError
from eigenfail.values import Rate, Region
from eigenfail.values.report import Cell, ReportSection
from eigenfail_services.campaigns.region import region_of
from eigenfail_services.reports import formats
from eigenfail_services.reports.material import Material
from eigenfail_services.reports.parts import Grid, Part, table

TABLE = "region"
COLUMNS = (
    ("campaigns", "Campaigns"),
    ("box", "Part"),
    ("parameter", "Parameter"),
    ("low", "from"),
    ("high", "to"),
    ("unit", "Unit"),
    ("coverage", "Share of the failures inside", "share"),
    ("precision", "Failure rate inside", "share"),
    ("precision_low", "from", "share"),
    ("precision_high", "to", "share"),
)
WORDS = (
    "Where the scenario's parameters vary from episode to episode or from campaign to campaign, a "
    "small decision tree looks for the parts in which the planner fails more often. It was grown "
    "on one half of the episodes; all figures are of the other half, with intervals of 95 %."
)
HEADER = ("Campaigns", "Where", "Share of the failures inside", "Failure rate inside")


def part(material: Material) -> Part | None:
    """The failing regions of campaigns on one planner in one scenario."""
    found = [region for region in regions(material) if region.parameters]
    if not found:
        return None
    section = ReportSection(
        name="region",
        title="Failing region",
        words=(WORDS, *(sentence for region in found for sentence in told(region))),
        tables=(table(TABLE, "Parts of the failing region", COLUMNS, [*rows(found)]),),
    )
    lines = tuple(line for region in found for line in worded(region))
    return Part(section, {TABLE: (Grid(HEADER, lines),)} if lines else {})


def regions(material: Material) -> Iterator[Region]:
    """One for each planner in each scenario, as far as that scenario is here."""
    together: dict[tuple[str, ...], list[int]] = {}
    for subject in material.subjects:
        spec = subject.campaign.spec
        together.setdefault((spec.scenario, spec.planner, spec.simulator), []).append(subject.id)
    for ids in together.values():
        try:
            yield region_of(material.store, ids)
        except InputError:
            continue


def listed(region: Region) -> str:
    """The campaigns that a region is of."""
    return ", ".join(map(str, region.campaigns))


def told(region: Region) -> Iterator[str]:
    """What keeps a region from saying more, or how surely it is one."""
    who = f"Campaigns {listed(region)}"
    found = f"{region.failures:,} failures in {region.episodes:,} episodes"
    yield f"{who}: {', '.join(region.parameters)} vary; {found}."
    if region.p_value is not None:
        p_value = formats.number(region.p_value)
        yield f"{who}: chance alone would put so many failures there with p = {p_value}."
    yield from (f"{who}: {note}" for note in (region.problem, *region.warnings) if note)


def rows(found: list[Region]) -> Iterator[tuple[Cell, ...]]:
    """A row for each bound of each part."""
    for region in found:
        for number, box in enumerate(region.boxes, start=1):
            rate = box.precision
            inside = (rate.value, rate.interval.low, rate.interval.high) if rate else (None,) * 3
            for bound in box.bounds:
                where = (bound.parameter, bound.low, bound.high, bound.unit)
                yield (listed(region), number, *where, box.coverage.value, *inside)


def worded(region: Region) -> Iterator[tuple[formats.Lines, ...]]:
    """A row for each part, in words."""
    for box in region.boxes:
        yield ((listed(region),), (box.words,), share(box.coverage), share(box.precision))


def share(found: Rate | None) -> formats.Lines:
    """A share with its interval and what it rests on."""
    if found is None:
        return (formats.NONE,)
    bounds = formats.bounds(found.interval, 100.0)
    return (formats.percent(found.value), f"95 %: {bounds} %, {found.k:,} of {found.n:,}")
