"""A suite as one table: the newest campaign of each member, and figures over seeds."""

from collections.abc import Iterator

from eigenfail.errors import NotFound
from eigenfail.suites import MOST_MEMBERS, KeyPath, shorten_paths
from eigenfail.values import Campaign, Summary
from eigenfail.values.campaign import CampaignFilter
from eigenfail.values.suite import SuiteRow, SuiteTable, member_of
from eigenfail_services.campaigns.seeds import (
    list_differing,
    list_given_settings,
    make_spreads,
)
from eigenfail_services.campaigns.summary import summaries_of
from eigenfail_services.store import Store

PAGE = 200


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
    columns = shorten_paths(list_differing([each.spec for _, each in members]))
    found = [each for _, each in members]
    summaries = summaries_of(store, found)
    return SuiteTable(
        suite=suite,
        columns=tuple(columns.values()),
        members=tuple(
            _make_row(name, each, columns, summary)
            for (name, each), summary in zip(members, summaries, strict=True)
        ),
        earlier=len(campaigns) - len(newest),
        left_out=len(newest) - len(members),
        over_seeds=make_spreads(found, summaries),
    )


def _list_campaigns(store: Store, suite: str) -> Iterator[Campaign]:
    page = store.campaigns.page(PAGE, where=CampaignFilter(suite=suite))
    yield from page.items
    while page.next is not None:
        page = store.campaigns.page(PAGE, page.next, CampaignFilter(suite=suite))
        yield from page.items


def _make_row(
    member: str, campaign: Campaign, columns: dict[KeyPath, str], summary: Summary
) -> SuiteRow:
    given = list_given_settings(campaign.spec)
    return SuiteRow(
        member=member,
        campaign=campaign.id,
        state=campaign.state,
        stopped_because=campaign.stopped_because,
        settings={name: given[path] for path, name in columns.items() if path in given},
        summary=summary,
    )
