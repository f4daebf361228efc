"""Which campaigns of a service are a suite's, and which of its members may be created now."""

from collections.abc import Iterator, Mapping, Sequence

from eigenfail.suites.references import in_order, references, resolved
from eigenfail.suites.suite import Member, Suite
from eigenfail.values import Campaign, CampaignSpec, CampaignState

Found = dict[str, Campaign]
"""The campaigns of members that have one, by the members' names."""


def recognised(suite: Suite, alike: Mapping[str, Sequence[Campaign]]) -> Found:
    """The campaigns of a suite's members.

    Args:
        suite: whose campaigns.
        alike: campaigns of the same name as a member's, by that name, newest first.

    Raises:
        UnknownName: a member builds upon one that there is not.
        InvalidValue: some wait for each other.
    """
    found: Found = {}
    for member in ordered(suite):
        if all(name in found for name in references(member.spec)):
            spec = numbered(member, found)
            for campaign in alike.get(spec.name, ()):
                if campaign.spec.is_like(spec):
                    found.setdefault(member.name, campaign)
    return found


def ready(suite: Suite, found: Found) -> Iterator[tuple[str, CampaignSpec]]:
    """Names and campaigns of members that have none yet and build upon none that is not done.

    Raises:
        UnknownName: a member builds upon one that there is not.
        InvalidValue: some wait for each other.
    """
    done = {name for name, one in found.items() if one.state is CampaignState.DONE}
    for member in ordered(suite):
        if member.name not in found and done.issuperset(references(member.spec)):
            yield member.name, numbered(member, found)


def ordered(suite: Suite) -> Iterator[Member]:
    """The members, each behind those that it builds upon."""
    members = {member.name: member for member in suite.members}
    names = in_order({name: one.spec for name, one in members.items()}, suite.name)
    return (members[name] for name in names)


def numbered(member: Member, found: Found) -> CampaignSpec:
    """A member's campaign with the numbers of those that it builds upon."""
    return resolved(member.spec, lambda name: found[name].id)
