"""Suites as they are printed: what would run, and what came of it."""

from collections.abc import Iterator, Sequence

import msgspec
from rich.console import Group, RenderableType
from rich.markup import escape
from rich.text import Text

from eigenfail.cli.figures import UNKNOWN, probability
from eigenfail.cli.tables import (
    PROBABILITY,
    RESULT_COLUMNS,
    RESULT_FIGURES,
    remarked,
    result_row,
    table,
)
from eigenfail.suites import Member, Suite
from eigenfail.values import Campaign, CampaignState, Summary


class SuitePlan(msgspec.Struct, frozen=True):
    """What would be run.

    Attributes:
        episodes: the budget of all members together.
    """

    suite: str
    campaigns: int
    episodes: int
    members: tuple[Member, ...]


class MemberResult(msgspec.Struct, frozen=True):
    """What came of a member; no state and no summary where there is no campaign yet."""

    name: str
    state: CampaignState | None = None
    stopped_because: str = ""
    summary: Summary | None = None


class SuiteResult(msgspec.Struct, frozen=True):
    """A suite as it stands."""

    suite: str
    episodes: int
    members: tuple[MemberResult, ...]


def plan_of(suite: Suite) -> SuitePlan:
    """What running a suite would do."""
    return SuitePlan(suite.name, len(suite.members), suite.episodes, suite.members)


def result_of(
    suite: Suite, campaigns: Sequence[Campaign | None], summaries: Sequence[Summary | None]
) -> SuiteResult:
    """What came of a suite's members, in order."""
    together = zip(suite.members, campaigns, summaries, strict=True)
    return SuiteResult(suite.name, suite.episodes, tuple(member_result(*one) for one in together))


def member_result(
    member: Member, campaign: Campaign | None, summary: Summary | None
) -> MemberResult:
    """What came of one of them."""
    if campaign is None:
        return MemberResult(member.name)
    return MemberResult(member.name, campaign.state, campaign.stopped_because, summary)


def plan_table(plan: SuitePlan) -> Group:
    """What would be run, and the budget."""
    words = ("member", "method", "scenario", "planner")
    grid = table(*words, "seed", "episodes", right=("seed", "episodes"))
    for member in plan.members:
        spec = member.spec
        names = (member.name, spec.method, spec.scenario, spec.planner)
        grid.add_row(*(escape(name) for name in names), str(spec.seed), str(spec.episodes))
    budget = f"{plan.suite}: {plan.campaigns} campaigns, {plan.episodes} episodes in all"
    return Group(grid, Text(budget))


def suite_table(result: SuiteResult) -> RenderableType:
    """One row for each member: what a campaign's result table says, and which member it is."""
    told = any(member.summary and member.summary.estimate for member in result.members)
    columns = ("member", "state", *RESULT_COLUMNS, *told * PROBABILITY)
    grid = table(*columns, right={*RESULT_FIGURES, *PROBABILITY})
    for member in result.members:
        last = probability(member.summary.estimate if member.summary else None)
        grid.add_row(*map(escape, (*cells(member), *told * (last,))))
    return remarked(grid, (member.summary for member in result.members if member.summary))


def cells(member: MemberResult) -> Iterator[str]:
    """A row of the suite's table, but for the probability."""
    yield member.name
    yield member.state or UNKNOWN
    if member.summary is None:
        yield from (UNKNOWN for _ in RESULT_COLUMNS)
    else:
        yield from result_row(member.summary)
