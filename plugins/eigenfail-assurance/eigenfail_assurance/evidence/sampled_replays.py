"""A sample of the episodes of a bundle, run again on this machine and compared by digest."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np

from eigenfail.errors import EigenfailError, InputError, ServiceError
from eigenfail.replays import ReplayedOutcome, replay_in_process
from eigenfail.values.episode import EpisodeTask, Outcome, PriorSource, TrajectorySource
from eigenfail.versions import differences, versions
from eigenfail_assurance.evidence.counting import CountedCampaign
from eigenfail_assurance.evidence.records import CampaignRecord, RecordedEpisode, follows_from_seed
from eigenfail_assurance.evidence.storage import BundleDefect


class SampledEpisode(NamedTuple):
    """An episode that can be run again.

    Attributes:
        campaign: id of its campaign.
        stored: the episode as the bundle has it.
        task: runs it again.
    """

    campaign: int
    stored: RecordedEpisode
    task: EpisodeTask


class ReplayFindings(NamedTuple):
    """Number of replays, differences that they found, and why other episodes were not replayed."""

    replayed: int
    defects: tuple[BundleDefect, ...]
    notes: tuple[str, ...]


def choose_episodes(
    campaigns: Mapping[int, CampaignRecord], count: int, seed: int
) -> list[SampledEpisode]:
    """Return a random sample of the episodes that can be run again, by campaign and index.

    An episode can be run again if its noise follows from its seed or is recorded.

    Args:
        campaigns: records by id.
        count: size of the sample; all episodes if there are not as many.
        seed: of the choice.

    Raises:
        InvalidValue: episodes or noise cannot be read.
    """
    candidates = [
        (campaign, episode)
        for campaign in sorted(campaigns)
        for episode in _list_candidates(campaigns[campaign])
    ]
    generator = np.random.default_rng(seed)
    size = min(count, len(candidates))
    chosen = sorted(generator.choice(len(candidates), size, replace=False).tolist()) if size else []
    return [
        SampledEpisode(campaign, episode, _make_task(campaigns[campaign], episode))
        for campaign, episode in (candidates[place] for place in chosen)
    ]


def _list_candidates(record: CampaignRecord) -> Iterator[RecordedEpisode]:
    recorded = {each.index for each in record.noise}
    for episode in CountedCampaign(record).episodes:
        is_known = follows_from_seed(episode) or episode.index in recorded
        if is_known and episode.outcome is not Outcome.ERRORED:
            yield episode


def _make_task(record: CampaignRecord, episode: RecordedEpisode) -> EpisodeTask:
    if follows_from_seed(episode):
        return EpisodeTask(episode.index, episode.seed, PriorSource())
    noise = next(each for each in record.noise if each.index == episode.index)
    return EpisodeTask(episode.index, episode.seed, TrajectorySource(noise.read()))


def replay_episodes(
    campaigns: Mapping[int, CampaignRecord], chosen: Sequence[SampledEpisode]
) -> ReplayFindings:
    """Run episodes again in processes of their own, and compare outcomes and digests.

    This runs the planners and simulators that the bundle names, if they are installed here.

    Raises:
        ServiceError: none of the episodes can be run here.
    """
    defects, notes, replayed = list[BundleDefect](), list[str](), 0
    for campaign, group in groupby(chosen, key=lambda each: each.campaign):
        sampled, record = list(group), campaigns[campaign]
        for each, again in zip(sampled, _run_again(record, sampled), strict=False):
            if isinstance(again, EigenfailError):
                notes.append(f"Not all of campaign {campaign} was run again: {again}")
                continue
            replayed += 1
            defects += _compare_outcomes(record, each, again)
    if notes and not replayed:
        raise ServiceError(notes[0], "Install what the campaigns run with, or omit --replay.")
    if not chosen:
        notes.append("No episode can be run again: neither seeds nor recorded noise give it.")
    return ReplayFindings(replayed, tuple(defects), tuple(dict.fromkeys(notes)))


def _run_again(
    record: CampaignRecord, sampled: Sequence[SampledEpisode]
) -> Iterator[ReplayedOutcome | EigenfailError]:
    try:
        yield from replay_in_process(record.campaign.spec, [each.task for each in sampled])
    except (InputError, ServiceError) as error:
        yield error


def _compare_outcomes(
    record: CampaignRecord, sampled: SampledEpisode, again: ReplayedOutcome
) -> Iterator[BundleDefect]:
    """Yield the difference between an episode and its replay, with the versions that differ."""
    stored, table = sampled.stored, f"campaigns/{sampled.campaign}.episodes.csv"
    if (stored.outcome, stored.digest) == (again.outcome, again.digest):
        return
    parts = record.campaign.parts
    differing = differences(parts[-1].versions, versions()) if parts else ()
    because = f" Versions differ: {'; '.join(differing)}." if differing else ""
    field = "digest" if stored.outcome is again.outcome else "outcome"
    one, other = (
        (stored.digest, again.digest)
        if field == "digest"
        else (stored.outcome.word, again.outcome.word)
    )
    problem = f"It is {one}, and that of a replay is {other}. {again.problem}{because}".strip()
    yield BundleDefect(where=f"{table}: {field} of episode {stored.index}", problem=problem)
