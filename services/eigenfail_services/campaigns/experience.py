"""Episodes of earlier campaigns as data, for a campaign that learns from them at first."""

from collections.abc import Iterator, Sequence
from itertools import groupby

import msgspec
import numpy as np

from eigenfail.contracts import Store
from eigenfail.errors import InvalidValue
from eigenfail.values import Campaign, CampaignSpec, EpisodeResult, Experience, Floats, Outcome
from eigenfail_services.campaigns.checks import horizon
from eigenfail_services.campaigns.earlier import ended, search

SETTING = "data_from"
"""The setting, of any method, that names the campaigns."""

MOST_READ = 100_000
"""Episodes that are looked through, of all campaigns together."""

MOST_EPISODES = 10_000
MOST_NUMBERS = 25_000_000
"""Of noise; they travel in one message."""

PAGE = 5_000


class Lived(msgspec.Struct, frozen=True, order=True):
    """A completed episode; they are ordered by robustness, then as they were run."""

    robustness_m: float
    campaign: int
    index: int


def experience(spec: CampaignSpec, store: Store) -> Experience | None:
    """Noise and robustness of the completed episodes of the campaigns that the settings name.

    In order of campaign and index. Where there are more than `MOST_EPISODES`, or than hold
    `MOST_NUMBERS`, it is the least robust, and an even sample of the others by robustness, as many
    of these as of those.

    Raises:
        InvalidValue: see `data_campaigns`.
    """
    named = data_campaigns(spec, store)
    if not named:
        return None
    steps = horizon(spec)
    lived = sorted(one for before in named for one in completed(before.id, store))
    kept = chosen(lived, min(MOST_EPISODES, MOST_NUMBERS // (2 * steps)))
    kept.sort(key=lambda one: (one.campaign, one.index))
    results = read(kept, store)
    return Experience(
        z=stack([result.noise.z for result in results], steps),
        steps=np.array([result.steps for result in results], np.float32),
        robustness_m=np.array([one.robustness_m for one in kept], np.float32),
    )


def data_campaigns(spec: CampaignSpec, store: Store) -> tuple[Campaign, ...]:
    """The campaigns whose episodes the settings name as data, by id; none if they name none.

    Raises:
        InvalidValue: no such campaign, it has not ended, it has completed no episode, its episodes
            are of another length or were pruned, or there are too many to be looked through.
    """
    found = search(spec)
    field = f"{found.field}.{SETTING}"
    numbers = sorted(set(found.settings.get(SETTING) or ()))
    named = tuple(ended(number, field, store) for number in numbers)
    for before in named:
        check_data(before, field, horizon(spec))
        refuse_pruned(before, field, store)
    if (count := sum(before.counts.completed for before in named)) > MOST_READ:
        problem = f"{count:,} episodes are more than the {MOST_READ:,} that can be looked through."
        raise InvalidValue(field, problem, "Name fewer or smaller campaigns.")
    return named


def check_data(before: Campaign, field: str, steps: int) -> None:
    """Make sure that a campaign's episodes can be learnt from.

    Raises:
        InvalidValue: there are none, or of another length.
    """
    if not before.counts.completed:
        problem = f"campaign {before.id} has not completed a single episode."
        raise InvalidValue(field, problem, "Name one that has.")
    if (there := horizon(before.spec)) != steps:
        problem = (
            f"the episodes of campaign {before.id} have {there} steps, here they have {steps}."
        )
        raise InvalidValue(field, problem, "Name campaigns in scenarios of as many steps.")


def refuse_pruned(before: Campaign, field: str, store: Store) -> None:
    """Raises InvalidValue where noise of a campaign was pruned: what is left is another sample."""
    if records := store.retention.of(before.id):
        lost = sum(each.weight.episodes for each in records)
        problem = f"the noise of {lost:,} episodes of campaign {before.id} was pruned."
        raise InvalidValue(field, problem, "Name another, or restore a backup from before.")


def completed(campaign: int, store: Store) -> Iterator[Lived]:
    """The completed episodes of a campaign whose robustness is known."""
    after: int | None = None
    while True:
        page = store.episodes.page(campaign, PAGE, after)
        for row in page.items:
            if row.outcome is not Outcome.FAILED and row.robustness_m is not None:
                yield Lived(row.robustness_m, campaign, row.index)
        if (after := page.next) is None:
            return


def chosen(lived: Sequence[Lived], most: int) -> list[Lived]:
    """At most that many of episodes in order: the least robust half, the others evenly."""
    if len(lived) <= most:
        return list(lived)
    least, others = lived[: most // 2], lived[most // 2 :]
    places = np.linspace(0, len(others) - 1, most - len(least)).round().astype(int)
    return [*least, *(others[place] for place in places)]


def read(lived: Sequence[Lived], store: Store) -> list[EpisodeResult]:
    """The results of episodes in order of campaign and index, in that order."""
    return [
        result
        for campaign, ours in groupby(lived, key=lambda one: one.campaign)
        for result in store.episodes.finished(campaign, [one.index for one in ours])
    ]


def stack(noises: Sequence[Floats], steps: int) -> Floats:
    """Trajectories of any length as one array, shape (n, steps, 2); no noise after their end."""
    stacked = np.zeros((len(noises), steps, 2), np.float32)
    for row, noise in zip(stacked, noises, strict=True):
        row[: len(noise)] = noise[:steps]
    return stacked
