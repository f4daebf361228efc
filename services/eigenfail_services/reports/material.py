"""What the sections of a report are made of."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from eigenfail.contracts import Store
from eigenfail.errors import InvalidValue
from eigenfail.values import (
    FINAL_STATES,
    Analysis,
    Campaign,
    Course,
    Safety,
    Summary,
)
from eigenfail.values.report import MOST_CAMPAIGNS
from eigenfail_services.campaigns.course import course_of
from eigenfail_services.campaigns.safety import safety_of
from eigenfail_services.campaigns.spending import newest
from eigenfail_services.campaigns.summary import summarise

LONGEST_LABEL = 36


class Subject(NamedTuple):
    """A campaign, and what the store knows of it.

    Attributes:
        analysis: the newest one that is done; None without one.
        place: in the report, from 0; how it is drawn follows from it.
    """

    campaign: Campaign
    summary: Summary
    course: Course
    safety: Safety
    analysis: Analysis | None
    place: int

    @property
    def id(self) -> int:
        """Of the campaign."""
        return self.campaign.id

    @property
    def label(self) -> str:
        """Its number and name, short enough for a picture."""
        name = self.campaign.spec.name
        short = name if len(name) <= LONGEST_LABEL else f"{name[: LONGEST_LABEL - 1]}…"
        return f"{self.id}: {short}"


class Material(NamedTuple):
    """The campaigns of a report in the order asked for, and where more of them is found."""

    store: Store
    subjects: tuple[Subject, ...]


def gather(store: Store, campaigns: Sequence[int]) -> Material:
    """What there is by now.

    Raises:
        InvalidValue: no campaign, too many, or one that is named twice.
        NotFound: no such campaign.
    """
    check(campaigns)
    numbered = enumerate(campaigns)
    return Material(store, tuple(subject(store, campaign, place) for place, campaign in numbered))


def check(campaigns: Sequence[int]) -> None:
    """Refuse what no report can be made of."""
    if not 1 <= len(campaigns) <= MOST_CAMPAIGNS:
        problem = f"{len(campaigns)} are named."
        raise InvalidValue("campaign", problem, f"Name 1 to {MOST_CAMPAIGNS}.")
    for campaign in campaigns:
        if campaigns.count(campaign) > 1:
            raise InvalidValue("campaign", f"{campaign} is named twice.", "Name each one once.")


def subject(store: Store, campaign: int, place: int) -> Subject:
    """One campaign, as it stands."""
    seen = store.campaigns.get(campaign)
    return Subject(
        campaign=seen,
        summary=summarise(seen, store.episodes.totals(campaign)),
        course=course_of(store, seen),
        safety=safety_of(store, seen),
        analysis=newest(store, seen),
        place=place,
    )


def unfinished(material: Material) -> Iterator[str]:
    """Whose figures may still change, or rest on less than was asked for."""
    for each in material.subjects:
        campaign = each.campaign
        if campaign.state not in FINAL_STATES:
            yield f"Campaign {each.id} is {campaign.state}: its figures may still change."
        if campaign.counts.failed:
            yield f"Campaign {each.id}: {campaign.counts.failed} episodes could not be run."
