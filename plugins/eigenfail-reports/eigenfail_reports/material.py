"""The material of a report's sections: campaigns, analyses, and samples of episodes."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from eigenfail.errors import InputError, InvalidValue
from eigenfail.presentation.analyses import MOST_CHANNELS, pick_channels
from eigenfail.values.analysis import Analysis, AnalysisResult
from eigenfail.values.arrays import Floats
from eigenfail.values.campaign import FINAL_STATES, Campaign
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import EpisodeResult
from eigenfail.values.safety import Safety
from eigenfail.values.summary import Course, Summary
from eigenfail.versions import describe_mixed
from eigenfail.worlds import find_robustness_unit, world_of
from eigenfail_reports.contents import MOST_CAMPAIGNS, Cell
from eigenfail_services.campaigns.costs import find_newest
from eigenfail_services.campaigns.summary import find_course, find_safety, summarise_campaign
from eigenfail_services.store.store import Store

LONGEST_LABEL = 36


class Subject(NamedTuple):
    """A campaign with its stored results.

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
    def has_road(self) -> bool:
        """True if vehicles drive in it; no function has them."""
        return world_of(self.campaign.spec.simulator).has_road

    @property
    def label(self) -> str:
        """Its number and name, short enough for a picture."""
        name = self.campaign.spec.name
        short = name if len(name) <= LONGEST_LABEL else f"{name[: LONGEST_LABEL - 1]}…"
        return f"{self.id}: {short}"


class Material(NamedTuple):
    """The campaigns of a report in the requested order, and the store of further data."""

    store: Store
    subjects: tuple[Subject, ...]

    @property
    def has_roads(self) -> bool:
        """True if vehicles drive in any campaign."""
        return any(subject.has_road for subject in self.subjects)

    @property
    def has_functions(self) -> bool:
        """True if any campaign has a function as the system under test."""
        return not all(subject.has_road for subject in self.subjects)

    @property
    def robustness_unit(self) -> str:
        """Unit of robustness; robustness of a function or of requirements has none."""
        units = {find_robustness_unit(subject.campaign.spec) for subject in self.subjects}
        return "m on the road" if len(units) > 1 else units.pop()

    def pick_words(self, road: str, function: str) -> str:
        """Return the words on the kinds of campaigns in the report, those on roads first."""
        return " ".join([road] * self.has_roads + [function] * self.has_functions)


def gather_material(store: Store, campaigns: Sequence[int]) -> Material:
    """Return the material of a report on campaigns in their current state.

    Raises:
        InvalidValue: no campaign, too many, or one that is named twice.
        NotFound: no such campaign.
    """
    check(campaigns)
    numbered = enumerate(campaigns)
    return Material(
        store, tuple(make_subject(store, campaign, place) for place, campaign in numbered)
    )


def check(campaigns: Sequence[int]) -> None:
    """Refuse campaigns that cannot be put into one report."""
    if not 1 <= len(campaigns) <= MOST_CAMPAIGNS:
        problem = f"{len(campaigns)} are named."
        raise InvalidValue("campaign", problem, f"Name 1 to {MOST_CAMPAIGNS}.")
    for campaign in campaigns:
        if campaigns.count(campaign) > 1:
            raise InvalidValue(
                "campaign", f"Campaign {campaign} is listed twice.", "List each once."
            )


def make_subject(store: Store, campaign: int, place: int) -> Subject:
    """Return a campaign in its current state."""
    seen = store.campaigns.get(campaign)
    return Subject(
        campaign=seen,
        summary=summarise_campaign(store, seen),
        course=find_course(store, seen),
        safety=find_safety(store, seen),
        analysis=find_newest(store, seen),
        place=place,
    )


def list_unfinished(material: Material) -> Iterator[str]:
    """Yield warnings on unfinished campaigns, mixed versions and errored episodes."""
    for each in material.subjects:
        campaign = each.campaign
        if campaign.state not in FINAL_STATES:
            yield f"Campaign {each.id} is {campaign.state}: its figures may still change."
        yield from (" ".join(sentences) for sentences in [describe_mixed(campaign)] if sentences)
        if campaign.counts.errored:
            yield f"Campaign {each.id}: {each.summary.errored.words(campaign.counts)}"


Item = TypeVar("Item")


def pick_evenly(items: Sequence[Item], most: int) -> list[Item]:
    """Return at most `most` items, spread evenly."""
    taken = min(len(items), most)
    return [items[place * len(items) // taken] for place in range(taken)] if taken else []


def split_into_groups(items: Sequence[Item], size: int) -> list[Sequence[Item]]:
    """Yield consecutive items in groups of a given size."""
    return [items[first : first + size] for first in range(0, len(items), size)]


def sample_note(shown: int, of: int, things: str) -> str:
    """That not all of them are shown; empty if they are."""
    return "" if shown >= of else f"A sample of {shown:,} of {of:,} {things}, spread evenly."


MOST_MEMBERS = 300
MOST_MODES = 4
"""How many modes of a campaign are drawn; the tables have all."""


class Analysed(NamedTuple):
    """A campaign with what PCA and clustering found in its failures.

    Attributes:
        medoids: the real failure nearest to each mode's centre, in the order of the modes.
        step_s: time of a step [s]; None if steps have none.
    """

    subject: Subject
    analysis: Analysis
    result: AnalysisResult
    medoids: tuple[EpisodeResult, ...]
    step_s: float | None

    @property
    def name(self) -> str:
        """Ends the names of its pictures."""
        return f"campaign-{self.subject.id}"

    @property
    def at_collision(self) -> bool:
        """True if the failures were aligned at their collision."""
        return self.analysis.settings.align == "collision"

    @property
    def modes_note(self) -> str:
        """That not all modes are drawn; empty if they are."""
        count = len(self.result.modes)
        return "" if count <= MOST_MODES else f"The {MOST_MODES} largest of {count} modes."

    @property
    def drawn_channels(self) -> list[tuple[int, str]]:
        """Column and name of the drawn channels: the channels of greatest influence, in order."""
        largest = pick_channels(self.result.influence)
        return [(way, self.result.channels[way]) for way in sorted(largest)]

    @property
    def channels_note(self) -> str:
        """That not all channels are drawn; empty if they are."""
        count = len(self.result.channels)
        if count <= MOST_CHANNELS:
            return ""
        return f"The {MOST_CHANNELS} channels of greatest influence, of {count}."

    def members(self, mode: int) -> list[tuple[int, int]]:
        """Campaign and episode of each failure of a mode."""
        count, own = len(self.result.episodes), self.subject.id
        campaigns = self.result.campaigns or (own,) * count
        rows = zip(campaigns, self.result.episodes, self.result.labels, strict=True)
        return [(campaign, episode) for campaign, episode, label in rows if label == mode]


def list_analysed(material: Material) -> Iterator[Analysed]:
    """Yield the campaigns that have an analysis with a mode."""
    for subject in material.subjects:
        analysis = subject.analysis
        if analysis is not None and analysis.result is not None and analysis.result.modes:
            medoids = tuple(
                material.store.episodes.get(mode.medoid_campaign or subject.id, mode.medoid)
                for mode in analysis.result.modes
            )
            duration = find_step_s(subject.campaign.spec)
            yield Analysed(subject, analysis, analysis.result, medoids, duration)


def list_channels(found: Sequence[Analysed]) -> tuple[str, ...]:
    """Return the channels of all of them, each once: the columns of a table with their noise."""
    return tuple(dict.fromkeys(channel for each in found for channel in each.result.channels))


def arrange_by_channel(
    cells: Sequence[Sequence[Cell]], own: Sequence[str], channels: Sequence[str]
) -> Iterator[Cell]:
    """Yield the cells of a row in the columns of a table; empty cells of a channel it has not.

    Args:
        cells: cells of each channel of the row, equally many for each channel.
        own: the channels of the row.
        channels: channels of the table.
    """
    by_name = dict(zip(own, cells, strict=True))
    nothing = (None,) * len(cells[0])
    for channel in channels:
        yield from by_name.get(channel, nothing)


def find_step_s(spec: CampaignSpec) -> float | None:
    """Return the duration of a step [s]; None for a scenario that is not installed here."""
    try:
        return world_of(spec.simulator).find_form(spec).step_s
    except InputError:
        return None


class Band(NamedTuple):
    """Mean and deviation of the noise of a mode's members, on the time axis of its eigenfailure.

    Attributes:
        shown: number of members it rests on, and of all.
        reached: how many of them reached each step, shape (steps,).
        mean: mean of z, shape (steps, channels); NaN if no member is. [sigma]
        deviation: standard deviation (n − 1), likewise; NaN if fewer than two are.
    """

    shown: int
    of: int
    reached: NDArray[np.int64]
    mean: NDArray[np.float64]
    deviation: NDArray[np.float64]


def make_band(store: Store, found: Analysed, mode: int) -> Band:
    """Return the noise of a mode's members, aligned at their first step or at their collision."""
    members = found.members(mode)
    chosen = pick_evenly(members, MOST_MEMBERS)
    noise = [
        result.noise.z
        for campaign in dict.fromkeys(campaign for campaign, _ in chosen)
        for result in store.episodes.finished(campaign, [e for c, e in chosen if c == campaign])
    ]
    rows = stack_noise(noise, found.result.modes[mode].eigenfailure.shape, found.at_collision)
    return Band(len(noise), len(members), *spread(rows))


def stack_noise(
    noise: list[Floats], shape: tuple[int, ...], at_collision: bool
) -> NDArray[np.float64]:
    """Return noise trajectories as rows of one length, with NaN if there is none.

    Args:
        noise: z of each, shape (its steps, channels).
        shape: of a row, (steps, channels).
        at_collision: whether the last steps, not the first, are aligned: at the median length, as
            in an eigenfailure.
    """
    rows = np.full((len(noise), *shape), np.nan)
    last = int(np.quantile([len(z) for z in noise], 0.5, method="higher")) if noise else 0
    for row, z in zip(rows, noise, strict=True):
        first = last - len(z) if at_collision else 0
        kept = z[max(-first, 0) :][: shape[0]]
        row[max(first, 0) : max(first, 0) + len(kept)] = kept
    return rows


def spread(
    rows: NDArray[np.float64],
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """How many rows reach each step, their mean and their standard deviation there."""
    reached = np.isfinite(rows[:, :, 0]).sum(axis=0)
    n = np.where(reached > 0, reached, np.nan)[:, None]
    mean = np.nansum(rows, axis=0) / n
    squares = np.nansum((rows - mean) ** 2, axis=0)
    return reached, mean, np.sqrt(squares / np.where(n > 1, n - 1.0, np.nan))
