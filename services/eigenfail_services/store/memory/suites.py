"""Suites in memory."""

from collections import Counter
from collections.abc import Iterable, Sequence

from eigenfail.values import Campaign, Page
from eigenfail.values.suite import SuiteStanding, suite_of


def suites_page(
    campaigns: Iterable[Campaign], limit: int, before: int | None
) -> Page[SuiteStanding]:
    """Suites by their newest campaigns, newest first, of those with ids below `before`."""
    members: dict[str, list[Campaign]] = {}
    for campaign in campaigns:
        if suite := suite_of(campaign.spec.name):
            members.setdefault(suite, []).append(campaign)
    found = sorted(
        (standing(name, of) for name, of in members.items()), key=lambda each: -each.newest
    )
    behind = [each for each in found if before is None or each.newest < before]
    more = len(behind) > limit
    return Page(tuple(behind[:limit]), behind[limit - 1].newest if more else None)


def standing(name: str, members: Sequence[Campaign]) -> SuiteStanding:
    """A suite from its campaigns."""
    counts = [each.counts for each in members]
    return SuiteStanding(
        name=name,
        newest=max(each.id for each in members),
        campaigns=len(members),
        states=dict(sorted(Counter(each.state for each in members).items())),
        planned=sum(each.planned for each in counts),
        completed=sum(each.completed for each in counts),
        failures=sum(each.failures for each in counts),
    )
