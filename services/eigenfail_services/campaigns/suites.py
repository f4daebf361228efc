"""A suite as one table: its members, and what differs between them."""

from collections.abc import Iterator, Sequence
from typing import Any

import msgspec

from eigenfail.contracts import Store
from eigenfail.errors import NotFound
from eigenfail.suites import MOST_MEMBERS
from eigenfail.suites.changes import Path, leaves, short_names
from eigenfail.values import Campaign, CampaignSpec, Summary
from eigenfail.values.suite import SuiteRow, SuiteTable, member_of
from eigenfail_services.campaigns.summary import summaries_of

PAGE = 200
DRAWN = "scenario_parameters"
"""A parameter may have a distribution in place of a value: that is one setting."""


def suite_table(store: Store, suite: str, most: int = MOST_MEMBERS) -> SuiteTable:
    """The newest campaign of each member, with the settings in which members differ.

    Args:
        store: where campaigns are.
        suite: its name.
        most: rows of the table at most; beyond that members with the newest campaigns are shown.

    Raises:
        NotFound: no campaign belongs to such a suite.
    """
    campaigns = list(campaigns_of(store, suite))
    if not campaigns:
        raise NotFound(
            f"No campaign belongs to a suite '{suite}'.",
            "`eigenfail suite list` shows which suites there are.",
        )
    newest = {member_of(each.spec.name): each for each in reversed(campaigns)}
    shown = dict(sorted(newest.items(), key=lambda one: -one[1].id)[:most])
    members = [(name, shown[name]) for name in newest if name in shown]
    columns = short_names(differing([each.spec for _, each in members]))
    summaries = summaries_of(store, [each for _, each in members])
    return SuiteTable(
        suite=suite,
        columns=tuple(columns.values()),
        members=tuple(
            row(name, each, columns, summary)
            for (name, each), summary in zip(members, summaries, strict=True)
        ),
        earlier=len(campaigns) - len(newest),
        left_out=len(newest) - len(members),
    )


def campaigns_of(store: Store, suite: str) -> Iterator[Campaign]:
    """All campaigns of a suite, newest first."""
    page = store.campaigns.page(PAGE, suite=suite)
    yield from page.items
    while page.next is not None:
        page = store.campaigns.page(PAGE, page.next, suite=suite)
        yield from page.items


def differing(specs: Sequence[CampaignSpec]) -> list[Path]:
    """Where specs do not all have the same, in the order of a spec's fields; names aside."""
    given = [settings_of(spec) for spec in specs]
    paths = dict.fromkeys(path for one in given for path in one)
    absent = object()
    found = [path for path in paths if any(differs(path, given[0], one, absent) for one in given)]
    return sorted(found, key=lambda path: CampaignSpec.__struct_fields__.index(path[0]))


def differs(path: Path, one: dict[Path, Any], other: dict[Path, Any], absent: object) -> bool:
    """Whether two have something else at a path."""
    return bool(one.get(path, absent) != other.get(path, absent))


def settings_of(spec: CampaignSpec) -> dict[Path, Any]:
    """All that a campaign was asked for but name and priority, each at its path."""
    table = msgspec.to_builtins(spec)
    del table["name"], table["priority"]
    drawn = table.pop(DRAWN)
    found: dict[Path, Any] = {path: value for path, value in leaves(table) if value != {}}
    return found | {(DRAWN, name): value for name, value in drawn.items()}


def row(member: str, campaign: Campaign, columns: dict[Path, str], summary: Summary) -> SuiteRow:
    """A member with what it has in the columns, and what came of it so far."""
    given = settings_of(campaign.spec)
    return SuiteRow(
        member=member,
        campaign=campaign.id,
        state=campaign.state,
        stopped_because=campaign.stopped_because,
        settings={name: given[path] for path, name in columns.items() if path in given},
        summary=summary,
    )
