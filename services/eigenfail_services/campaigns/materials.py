"""What a learner is born with: made from the campaign, and from what the store holds."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from eigenfail.contracts import Store
from eigenfail.errors import InvalidValue
from eigenfail.values import Campaign, Floats, LearnerContext, learner_seed
from eigenfail_services.campaigns.checks import horizon


def learner_context(campaign: Campaign, store: Store) -> LearnerContext:
    """The context of a campaign's learner.

    Raises:
        InvalidValue: its settings name trajectories that are not there.
        NotFound: its settings name an analysis or episode that is not there.
    """
    spec = campaign.spec
    steps = horizon(spec)
    return LearnerContext(
        seed=learner_seed(spec.seed),
        episodes=spec.episodes,
        horizon=steps,
        trajectories=stack(trajectories(spec.settings, store), steps),
    )


def trajectories(settings: dict[str, Any], store: Store) -> Sequence[Floats]:
    """The noise trajectories that a campaign's settings name; none if they name none."""
    for name, find in FINDERS.items():
        if settings.get(name) is not None:
            return find(settings, store)
    return ()


def eigenfailures(settings: dict[str, Any], store: Store) -> Sequence[Floats]:
    """The eigenfailures of the analysis in the settings."""
    analysis = store.analyses.get(settings["analysis"])
    if analysis.result is None:
        problem = f"analysis {analysis.id} is {analysis.state} and has no eigenfailures."
        raise InvalidValue("settings.analysis", problem, "Wait for it, or launch another.")
    return [mode.eigenfailure for mode in analysis.result.modes]


def recorded(settings: dict[str, Any], store: Store) -> Sequence[Floats]:
    """The noise of episodes of another campaign: those listed, or all of its failures."""
    campaign, episodes = settings["campaign"], settings.get("episodes")
    if not episodes:
        return store.episodes.failures(campaign).noise
    return [store.episodes.get(campaign, index).noise.z for index in episodes]


FINDERS: dict[str, Callable[[dict[str, Any], Store], Sequence[Floats]]] = {
    "analysis": eigenfailures,
    "campaign": recorded,
}


def stack(noises: Sequence[Floats], steps: int) -> Floats:
    """Trajectories of any length as one array, shape (n, steps, 2); no noise after their end."""
    stacked = np.zeros((len(noises), steps, 2), np.float32)
    for row, noise in zip(stacked, noises, strict=True):
        row[: len(noise)] = noise[:steps]
    return stacked
