"""Values in a notebook: the tables of the terminal as HTML.

The core finds `to_html` by its entry point.

Everything is escaped; scripts and styles are left out, so that the notebook's own styles apply.
"""

from collections.abc import Callable, Iterator
from functools import singledispatch
from html import escape
from itertools import chain
from typing import Any

from eigenfail.presentation import campaigns, figures
from eigenfail.presentation.analyses import (
    describe_modes,
    describe_proof,
    format_peak,
    list_mode_words,
)
from eigenfail.presentation.episodes import list_episode_facts, tabulate_episodes
from eigenfail.presentation.seeds import tabulate_spreads
from eigenfail.presentation.suites import describe_suite, tabulate_suites
from eigenfail.presentation.tables import Block, FactTable, Table, format_cell, name_columns
from eigenfail.values.analysis import Analysis, FailureMode, Mode
from eigenfail.values.campaign import Campaign
from eigenfail.values.comparison import Comparison
from eigenfail.values.proof import Proof
from eigenfail.values.records import EpisodeDetail, EpisodeRow
from eigenfail.values.rows import SHOWN, Rows
from eigenfail.values.safety import Safety
from eigenfail.values.seeds import SeedSpread
from eigenfail.values.suite import SuiteStanding, SuiteTable
from eigenfail.values.summary import CampaignCost, Course, Summary
from eigenfail_notebook.frames import flatten, number_channels

Blocks = tuple[Block, ...]

LISTS: dict[type, Callable[[Any], Table]] = {
    Campaign: campaigns.tabulate_campaigns,
    Summary: campaigns.tabulate_results,
    EpisodeRow: tabulate_episodes,
    SuiteStanding: tabulate_suites,
}
"""The tables of rows of a kind; rows of another kind show all of their fields."""


def to_html(value: object) -> str:
    """Return a value as HTML."""
    return "".join(chain.from_iterable(map(_render, describe(value))))


@singledispatch
def describe(value: object) -> Blocks:
    """Return the tables of a value."""
    return (repr(value),)


@describe.register
def _(value: Campaign) -> Blocks:
    return (campaigns.list_campaign_facts(value),)


@describe.register
def _(value: Summary) -> Blocks:
    return (campaigns.tabulate_results([value]),)


@describe.register
def _(value: SeedSpread) -> Blocks:
    return (tabulate_spreads([value]),)


@describe.register
def _(value: CampaignCost) -> Blocks:
    return campaigns.describe_costs([value])


describe.register(Course, campaigns.tabulate_course)
describe.register(Safety, campaigns.describe_safety)
describe.register(Comparison, campaigns.describe_comparison)
describe.register(SuiteTable, describe_suite)
describe.register(Proof, describe_proof)


@describe.register
def _(value: Analysis) -> Blocks:
    words = f"of campaign {value.campaign}: {value.state}"
    heading = FactTable("Analysis", ((f"analysis {value.id}", words),))
    if value.result is None:
        return (heading, value.problem)
    modes = describe_modes(value.campaign, value.result)
    return (heading, *modes, *list_mode_words(value.result))


@describe.register
def _(value: EpisodeRow) -> Blocks:
    return (tabulate_episodes([value]),)


@describe.register
def _(value: EpisodeDetail) -> Blocks:
    return (list_episode_facts(str(value.index), value),)


@describe.register
def _(value: FailureMode) -> Blocks:
    place = "" if value.medoid_campaign is None else f" of campaign {value.medoid_campaign}"
    steps, channels = value.eigenfailure.shape
    size = f"{figures.count_noun(steps, 'step')}, {figures.count_noun(channels, 'channel')}"
    # A mode whose failures have no noise has no peak to name.
    peaks = map(format_peak, value.typical.T) if steps else ()
    facts = [("number", str(value.number))] if value.number else []
    facts += [
        ("failures", figures.format_count(value.failures)),
        ("medoid", f"episode {value.medoid}{place}"),
        ("eigenfailure", size),
    ]
    named = zip(number_channels(channels), peaks, strict=False)
    facts += [(f"peak of {name} [sigma]", peak) for name, peak in named]
    if value.probability is not None:
        facts.append(("probability under p(x)", format_cell(value.probability).line))
    return (FactTable("Failure mode", tuple(facts)),)


@describe.register
def _(value: Mode) -> Blocks:
    return (_tabulate_fields((value,)),)


@describe.register
def _(value: Rows) -> Blocks:  # type: ignore[type-arg]  # singledispatch takes plain classes
    seen = value.first(SHOWN + 1)
    if not seen:
        return ("Nothing.",)
    table = LISTS.get(type(seen[0]), _tabulate_fields)(seen[:SHOWN])
    more = (f"The first {SHOWN}; there are more.",) if len(seen) > SHOWN else ()
    return (table, *more)


def _tabulate_fields(rows: tuple[object, ...]) -> Table:
    records = [flatten(row) for row in rows]
    names = tuple(dict.fromkeys(name for record in records for name in record))
    cells = tuple(tuple(str(record.get(name, "")) for name in names) for record in records)
    return Table("", name_columns(*names), cells)


def _render(block: Block) -> Iterator[str]:
    if isinstance(block, Table):
        heads = (f"<th>{escape(column.label)}</th>" for column in block.columns)
        yield f"<table><thead><tr>{''.join(heads)}</tr></thead><tbody>"
        for row in block.cells:
            yield f"<tr>{''.join(f'<td>{escape(cell.line)}</td>' for cell in row)}</tr>"
        yield "</tbody></table>"
        yield from chain.from_iterable(map(_render, block.notes))
    elif isinstance(block, FactTable):
        yield "<table><tbody>"
        for name, value in block.rows:
            yield f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>"
        yield "</tbody></table>"
    elif block:
        yield f"<p>{escape(block)}</p>"
