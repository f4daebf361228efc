"""A suite as one table: its members, and what differs between them."""

from collections.abc import Iterator, Sequence
from typing import Any

import msgspec

from eigenfail.errors import NotFound
from eigenfail.suites import MOST_MEMBERS, KeyPath, list_leaves, shorten_paths
from eigenfail.values import Campaign, CampaignSpec, Summary
from eigenfail.values.suite import SuiteRow, SuiteTable, member_of
from eigenfail_services.campaigns.summary import summaries_of
from eigenfail_services.store import Store

PAGE = 200
DRAWN = "scenario_parameters"
"""A parameter may have a distribution in place of a value: that is one setting."""


def make_suite_table(store: Store, suite: str, most: int = MOST_MEMBERS) -> SuiteTable:
    """Return the newest campaign of each member, with the settings in which members differ.

    Args:
        store: where campaigns are.
        suite: its name.
        most: rows of the table at most; beyond that members with the newest campaigns are shown.

    Raises:
        NotFound: no campaign belongs to such a suite.
    """
    campaigns = list(_list_campaigns(store, suite))
    if not campaigns:
        raise NotFound(
            f"No campaign belongs to a suite '{suite}'.",
            "`eigenfail suite list` shows which suites there are.",
        )
    newest = {member_of(each.spec.name): each for each in reversed(campaigns)}
    shown = dict(sorted(newest.items(), key=lambda one: -one[1].id)[:most])
    members = [(name, shown[name]) for name in newest if name in shown]
    columns = shorten_paths(_list_differing([each.spec for _, each in members]))
    summaries = summaries_of(store, [each for _, each in members])
    return SuiteTable(
        suite=suite,
        columns=tuple(columns.values()),
        members=tuple(
            _make_row(name, each, columns, summary)
            for (name, each), summary in zip(members, summaries, strict=True)
        ),
        earlier=len(campaigns) - len(newest),
        left_out=len(newest) - len(members),
    )


def _list_campaigns(store: Store, suite: str) -> Iterator[Campaign]:
    page = store.campaigns.page(PAGE, suite=suite)
    yield from page.items
    while page.next is not None:
        page = store.campaigns.page(PAGE, page.next, suite=suite)
        yield from page.items


def _list_differing(specs: Sequence[CampaignSpec]) -> list[KeyPath]:
    """Return the paths at which specs differ, in the order of a spec's fields; names aside."""
    given = [_list_settings(spec) for spec in specs]
    paths = dict.fromkeys(path for one in given for path in one)
    absent = object()
    found = [path for path in paths if any(_differs(path, given[0], one, absent) for one in given)]
    return sorted(found, key=lambda path: CampaignSpec.__struct_fields__.index(path[0]))


def _differs(
    path: KeyPath, one: dict[KeyPath, Any], other: dict[KeyPath, Any], absent: object
) -> bool:
    return bool(one.get(path, absent) != other.get(path, absent))


def _list_settings(spec: CampaignSpec) -> dict[KeyPath, Any]:
    """Return all settings of a campaign but name and priority, by path."""
    table = msgspec.to_builtins(spec)
    del table["name"], table["priority"]
    drawn = table.pop(DRAWN)
    found: dict[KeyPath, Any] = {path: value for path, value in list_leaves(table) if value != {}}
    return found | {(DRAWN, name): value for name, value in drawn.items()}


def _make_row(
    member: str, campaign: Campaign, columns: dict[KeyPath, str], summary: Summary
) -> SuiteRow:
    given = _list_settings(campaign.spec)
    return SuiteRow(
        member=member,
        campaign=campaign.id,
        state=campaign.state,
        stopped_because=campaign.stopped_because,
        settings={name: given[path] for path, name in columns.items() if path in given},
        summary=summary,
    )
