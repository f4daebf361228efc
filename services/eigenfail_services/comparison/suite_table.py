"""The table of a suite: its members, the settings in which they differ, and figures over seeds."""

from eigenfail import suites
from eigenfail.errors import NotFound
from eigenfail.values import Campaign, Summary
from eigenfail.values.suite import SuiteRow, SuiteTable, member_of
from eigenfail_services.campaigns.suites import list_members
from eigenfail_services.campaigns.summary import summaries_of
from eigenfail_services.comparison.questions import list_differing, list_given_settings
from eigenfail_services.comparison.seeds import make_spreads
from eigenfail_services.store import Store


def make_suite_table(store: Store, suite: str, most: int = suites.MOST_MEMBERS) -> SuiteTable:
    """Return the newest campaign of each member, with the settings in which members differ.

    Args:
        store: where campaigns are.
        suite: its name.
        most: rows of the table at most; beyond that members with the newest campaigns are shown.

    Raises:
        NotFound: no campaign belongs to such a suite.
    """
    campaigns = list(list_members(store, suite))
    if not campaigns:
        raise NotFound(
            f"No campaign belongs to a suite '{suite}'.",
            "`eigenfail suite list` shows which suites there are.",
        )
    newest = {member_of(each.spec.name): each for each in reversed(campaigns)}
    shown = dict(sorted(newest.items(), key=lambda one: -one[1].id)[:most])
    members = [(name, shown[name]) for name in newest if name in shown]
    columns = suites.shorten_paths(list_differing([each.spec for _, each in members]))
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


def _make_row(
    member: str, campaign: Campaign, columns: dict[suites.KeyPath, str], summary: Summary
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
