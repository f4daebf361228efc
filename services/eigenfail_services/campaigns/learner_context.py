"""What a learner is given at its birth: noise, data and learners of earlier campaigns."""

from collections.abc import Iterator, Sequence
from itertools import groupby

import msgspec
import numpy as np

from eigenfail import values
from eigenfail_services.campaigns import resolution
from eigenfail_services.store import Store

MOST_EPISODES = 10_000
MOST_NUMBERS = 25_000_000
"""Of noise; they travel in one message."""

PAGE = 5_000


class CompletedEpisode(msgspec.Struct, frozen=True, order=True):
    """A completed episode; they are ordered by robustness, then as they were run."""

    robustness_m: float
    campaign: int
    index: int


def learner_context(campaign: values.Campaign, store: Store) -> values.LearnerContext:
    """Return the context of a campaign's learner.

    Raises:
        InputError: a plug-in of the campaign is gone or refuses its settings; or these name
            trajectories, or campaigns to build upon, that do not exist or are of no use.
        NotFound: its settings name an analysis or episode that does not exist.
    """
    resolved = resolution.find_references(resolution.resolve_campaign(campaign.spec), store)
    trajectories = resolution.read_trajectories(resolved.searching, store)
    return values.LearnerContext(
        seed=values.learner_seed(campaign.spec.seed),
        episodes=campaign.spec.episodes,
        horizon=resolved.horizon,
        trajectories=stack_noise(trajectories, resolved.horizon, len(resolved.channels)),
        predecessors=resolved.references.predecessors,
        experience=read_experience(resolved, store),
        parallel=campaign.spec.parallel,
    )


def read_experience(
    campaign: resolution.ResolvedCampaign, store: Store
) -> values.Experience | None:
    """Return noise and robustness of the completed episodes that a campaign learns from.

    None where it names no campaigns to learn from.

    In order of campaign and index. Where there are more than `MOST_EPISODES`, or than hold
    `MOST_NUMBERS`, it is the least robust, and an even sample of the others by robustness, as many
    of these as of those.
    """
    data, horizon, channels = campaign.references.data, campaign.horizon, len(campaign.channels)
    if not data:
        return None
    completed = sorted(one for before in data for one in _list_completed(before.id, store))
    kept = choose_episodes(completed, min(MOST_EPISODES, MOST_NUMBERS // (channels * horizon)))
    kept.sort(key=lambda one: (one.campaign, one.index))
    results = _read_results(kept, store)
    return values.Experience(
        z=stack_noise([result.noise.z for result in results], horizon, channels),
        steps=np.array([result.steps for result in results], np.float32),
        robustness_m=np.array([one.robustness_m for one in kept], np.float32),
    )


def _list_completed(campaign: int, store: Store) -> Iterator[CompletedEpisode]:
    after: int | None = None
    while True:
        page = store.episodes.page(campaign, PAGE, after)
        for row in page.items:
            if row.outcome is not values.Outcome.ERRORED and row.robustness_m is not None:
                yield CompletedEpisode(row.robustness_m, campaign, row.index)
        if (after := page.next) is None:
            return


def choose_episodes(completed: Sequence[CompletedEpisode], most: int) -> list[CompletedEpisode]:
    """Return at most that many of episodes in order: the least robust half, the others evenly."""
    if len(completed) <= most:
        return list(completed)
    least, others = completed[: most // 2], completed[most // 2 :]
    places = np.linspace(0, len(others) - 1, most - len(least)).round().astype(int)
    return [*least, *(others[place] for place in places)]


def _read_results(episodes: Sequence[CompletedEpisode], store: Store) -> list[values.EpisodeResult]:
    return [
        result
        for campaign, ours in groupby(episodes, key=lambda one: one.campaign)
        for result in store.episodes.finished(campaign, [one.index for one in ours])
    ]


def stack_noise(noises: Sequence[values.Floats], steps: int, channels: int) -> values.Floats:
    """Return trajectories of any length as one array, shape (n, steps, channels).

    They are padded with zeros; without a trajectory n is 0.
    """
    stacked = np.zeros((len(noises), steps, channels), np.float32)
    for row, noise in zip(stacked, noises, strict=True):
        row[: len(noise)] = noise[:steps]
    return stacked
