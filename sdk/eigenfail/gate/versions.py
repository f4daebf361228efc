"""A suite at one version of its planners, and whether two campaigns ask the same of theirs."""

from collections.abc import Mapping, Sequence

from msgspec.structs import asdict, replace

from eigenfail.errors import Conflict, InvalidValue
from eigenfail.suites import Member, Suite
from eigenfail.suites.references import resolved
from eigenfail.values import Campaign, CampaignSpec, CampaignState

MAY_DIFFER = frozenset(
    {
        *("name", "planner", "planner_settings"),
        *("price_usd_per_hour", "instances", "scene_every", "priority"),
    }
)
"""Fields in which a baseline may differ: the planner itself, and what changes no episode."""


NOBODY = 0
"""No campaign has this number."""


def run_name(suite: str, version: str) -> str:
    """What a suite is called where it is run for one version of its planners."""
    return f"{suite} @ {version}"


def at_version(suite: Suite, version: str) -> Suite:
    """The same campaigns under the version's name, so that no other version's are found."""
    return renamed(suite, run_name(suite.name, version))


def renamed(suite: Suite, name: str) -> Suite:
    """The suite under another name."""
    members = (
        Member(each.name, replace(each.spec, name=f"{name}: {each.name}")) for each in suite.members
    )
    return Suite(name, tuple(members))


def run_of(campaign: Campaign, member: Member) -> str:
    """The name of the run that a campaign of a member belongs to."""
    return campaign.spec.name.removesuffix(f": {member.name}")


def differences(a: CampaignSpec, b: CampaignSpec) -> tuple[str, ...]:
    """In which fields two campaigns ask something else of their planners."""
    left, right = asdict(a), asdict(b)
    return tuple(name for name in left if name not in MAY_DIFFER and left[name] != right[name])


def check_baseline(suite: Suite, found: Mapping[str, Campaign], baseline: str) -> None:
    """Make sure that a baseline can be judged against.

    Args:
        suite: what is to be gated.
        found: the baseline's campaigns by the name of the member.
        baseline: as the user named it, for errors.

    Raises:
        InvalidValue: no member is in it, or one asks something else of its planner.
        Conflict: one of its campaigns is not done, or completed no episode.
    """
    if not found:
        members = ", ".join(member.name for member in suite.members[:5])
        problem = f"'{baseline}' holds none of the members of {suite.name} ({members})."
        raise InvalidValue("baseline", problem, WAYS_TO_NAME)
    for member in suite.members:
        if before := found.get(member.name):
            check_same_question(member, before, found)
            check_done(before)


def check_same_question(member: Member, before: Campaign, found: Mapping[str, Campaign]) -> None:
    """Raises InvalidValue if something else than the planner differs.

    A member that builds upon another asks the same if its baseline builds upon the other's.
    """
    ids = {name: campaign.id for name, campaign in found.items()}
    asked = resolved(member.spec, lambda name: ids.get(name, NOBODY))
    if differing := differences(asked, before.spec):
        raise InvalidValue(
            f"member '{member.name}'",
            f"{', '.join(differing)} of campaign {before.id}, its baseline, differ.",
            "Only the planner and its settings may: run the baseline with this suite again.",
        )


def check_done(before: Campaign) -> None:
    """Raises Conflict if a baseline's campaign says nothing yet, or nothing at all."""
    if before.state is not CampaignState.DONE:
        problem = f"Campaign {before.id} of the baseline is {before.state}."
        raise Conflict(problem, f"Let it end: eigenfail campaign show {before.id}")
    if not before.counts.completed:
        problem = f"Campaign {before.id} of the baseline completed no episode."
        raise Conflict(problem, f"See why: eigenfail episode list {before.id} --outcome failed")


def counterpart(member: Member, campaigns: Sequence[Campaign]) -> Campaign | None:
    """Which of some campaigns is the member's: that of its name, or else of its question.

    Raises:
        InvalidValue: more than one could be.
    """
    named = [each for each in campaigns if each.spec.name.endswith(f": {member.name}")]
    alike = named or [each for each in campaigns if not differences(member.spec, each.spec)]
    if len(alike) > 1:
        ids = ", ".join(str(each.id) for each in alike)
        problem = f"campaigns {ids} could all be that of member '{member.name}'."
        raise InvalidValue("baseline", problem, "Name one of them.")
    return alike[0] if alike else None


WAYS_TO_NAME = (
    "Name a version that was gated, a suite or its file that was run, or campaigns, such as 1,2,3;"
    " `eigenfail campaign list` shows what there is. Without --baseline one is made."
)
