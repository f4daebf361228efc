"""Minimal failures: what is left once all the noise that a failure does not need is gone."""

from collections.abc import Iterator

from eigenfail.errors import Conflict
from eigenfail.values import MinimalFailure
from eigenfail.values.report import Cell, ReportSection
from eigenfail_services.campaigns.minimal_failures import METHOD, minimal_failure
from eigenfail_services.reports.material import Material
from eigenfail_services.reports.parts import Part, table

COLUMNS = (
    ("campaign", "Campaign"),
    ("episode", "Episode"),
    ("done", "Search at its end"),
    ("needed", "Steps and axes needed"),
    ("injected", "of"),
    ("energy", "Energy", "sigma²"),
    ("full_energy", "of", "sigma²"),
    ("log_p_per_step", "log p per step", "nat"),
    ("full_log_p_per_step", "at full strength", "nat"),
)
WORDS = (
    "A failing noise trajectory with everything taken away that it does not need in order to fail. "
    "Each step along one axis counts as one; energy is the sum of z²."
)


def part(material: Material) -> Part | None:
    """The minimal failures that campaigns came to."""
    found = [*shrunk(material)]
    if not found:
        return None
    told = (f"Campaign {each.campaign}: {each.words} {each.because}" for each in found)
    section = ReportSection(
        name="minimal",
        title="Minimal failures",
        words=(WORDS, *told),
        tables=(table("minimal", "Minimal failures", COLUMNS, [*map(row, found)]),),
    )
    return Part(section)


def shrunk(material: Material) -> Iterator[MinimalFailure]:
    """Those of the campaigns that shrink failures, as far as there is one."""
    for subject in material.subjects:
        if subject.campaign.spec.method == METHOD:
            try:
                yield minimal_failure(material.store, subject.campaign)
            except Conflict:
                continue


def row(found: MinimalFailure) -> tuple[Cell, ...]:
    """The numbers of a minimal failure."""
    return (
        *(found.campaign, found.index, found.done, found.needed, found.injected),
        *(found.energy, found.full_energy),
        *(found.log_probability_per_step, found.full_log_probability_per_step),
    )
