"""Versions of a suite, and the baseline campaigns that a gate compares with."""

from collections.abc import Callable, Mapping, Sequence

from msgspec.structs import asdict, replace

from eigenfail.errors import Conflict, InvalidValue
from eigenfail.suites import Suite, SuiteMember, resolve_references
from eigenfail.values.campaign import Campaign, CampaignState
from eigenfail.values.campaign_spec import SPEC_FIELDS, CampaignSpec

MAY_DIFFER = frozenset(
    {
        "planner",
        "planner_settings",
        *(name for name, field in SPEC_FIELDS.items() if not field.changes_episodes),
    }
)
"""Fields in which a baseline may differ: the planner itself, and what changes no episode."""


HOLD_DEFAULTS = frozenset({"settings", "scenario_parameters"})
"""Fields that plug-ins complete, apart from those that may differ anyway."""


Resolve = Callable[[CampaignSpec], CampaignSpec]
"""Returns a spec with the defaults of its plug-ins written out; only a service knows them."""


def name_run(suite: str, version: str) -> str:
    """Return the name of a suite's run for one version of its planners."""
    return f"{suite} @ {version}"


def select_version(suite: Suite, version: str) -> Suite:
    """Return the suite for a version: renamed, so that only campaigns of that version match."""
    run = name_run(suite.name, version)
    members = []
    for each in suite.members:
        spec = replace(each.spec, name=f"{run}: {each.name}", planner_version=version)
        members.append(SuiteMember(each.name, spec))
    return Suite(run, tuple(members))


def find_run(campaign: Campaign, member: SuiteMember) -> str:
    """Return the name of the run that a campaign of a member belongs to."""
    return campaign.spec.name.removesuffix(f": {member.name}")


def list_differences(
    a: CampaignSpec, b: CampaignSpec, resolve: Resolve = lambda spec: spec
) -> tuple[str, ...]:
    """Return the fields that make two campaigns test their planners differently.

    Specs that differ as given are compared again with their defaults written out.
    """
    # Writing out defaults asks the service, which most pairs of campaigns can do without.
    found = list_differing_fields(a, b)
    return found and list_differing_fields(resolve(a), resolve(b))


def list_differing_fields(a: CampaignSpec, b: CampaignSpec) -> tuple[str, ...]:
    """Return the fields with different values, except fields that may differ."""
    # Two ways to write the same noise, or the same requirements, are no difference.
    if a.disturbance.is_like(b.disturbance):
        b = replace(b, disturbance=a.disturbance)
    if a.all_requirements == b.all_requirements:
        b = replace(b, requirements=a.requirements)
    left, right = asdict(a), asdict(b)
    return tuple(name for name in left if name not in MAY_DIFFER and left[name] != right[name])


def check_baseline(
    suite: Suite, found: Mapping[str, Campaign], baseline: str, resolve: Resolve = lambda spec: spec
) -> None:
    """Check that a gate can compare with a baseline.

    Args:
        suite: the suite that the gate reruns.
        found: the baseline's campaigns by the name of the member.
        baseline: the baseline as the user named it, for errors.
        resolve: writes out the defaults of a spec.

    Raises:
        InvalidValue: it does not contain any member, or one tests its planner differently.
        Conflict: one of its campaigns is not done, or completed no episode.
    """
    if not found:
        members = ", ".join(member.name for member in suite.members[:5])
        problem = f"'{baseline}' contains no members of {suite.name} ({members})."
        raise InvalidValue("baseline", problem, WAYS_TO_NAME)
    ids = {name: campaign.id for name, campaign in found.items()}
    for member in suite.members:
        if (before := found.get(member.name)) is None:
            continue
        # A member that builds upon another asks the same if its baseline builds upon the other's.
        # No campaign has the number 0.
        asked = resolve_references(member.spec, lambda name: ids.get(name, 0))
        if differing := list_differences(asked, before.spec, resolve):
            raise InvalidValue(
                f"member '{member.name}'",
                f"{', '.join(differing)} of campaign {before.id}, its baseline, differ.",
                "Only the planner and its settings may: run the baseline with this suite again.",
            )
        if before.state is not CampaignState.DONE:
            problem = f"Campaign {before.id} of the baseline is {before.state}."
            raise Conflict(problem, f"Wait for it to end: eigenfail campaign show {before.id}")
        if not before.counts.completed:
            problem = f"Campaign {before.id} of the baseline completed no episode."
            see = f"See why: eigenfail episode list {before.id} --outcome errored"
            raise Conflict(problem, see)


def find_counterpart(
    member: SuiteMember, campaigns: Sequence[Campaign], resolve: Resolve = lambda spec: spec
) -> Campaign | None:
    """Return the campaign that belongs to a member: by its name, or else by equal settings.

    Raises:
        InvalidValue: more than one campaign matches.
    """
    # Members that vary a planner's settings alone ask the same: only names tell them apart.
    named = [each for each in campaigns if each.spec.name.endswith(f": {member.name}")]
    alike = named or [
        each
        for each in campaigns
        # Only where fields that hold defaults alone differ is it worth to ask the service.
        if HOLD_DEFAULTS.issuperset(list_differing_fields(member.spec, each.spec))
        and not list_differences(member.spec, each.spec, resolve)
    ]
    if len(alike) > 1:
        ids = ", ".join(str(each.id) for each in alike)
        problem = f"campaigns {ids} could all be that of member '{member.name}'."
        raise InvalidValue("baseline", problem, "Name one of them.")
    return alike[0] if alike else None


WAYS_TO_NAME = (
    "Name a version that was gated, a suite or its file that was run, or campaigns, such as 1,2,3;"
    " `eigenfail campaign list` shows what there is. Without --baseline one is made."
)
