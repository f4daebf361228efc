"""What a learner is born with: made from the campaign, and from what the store holds."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from eigenfail.contracts import Store
from eigenfail.errors import InvalidValue, NotFound
from eigenfail.values import Campaign, CampaignSpec, Floats, LearnerContext, learner_seed
from eigenfail_services.campaigns.checks import horizon
from eigenfail_services.campaigns.earlier import Search, search
from eigenfail_services.campaigns.experience import data_campaigns, experience, stack
from eigenfail_services.campaigns.predecessors import LEARNERS, predecessors


def learner_context(campaign: Campaign, store: Store) -> LearnerContext:
    """The context of a campaign's learner.

    Raises:
        InvalidValue: its settings name trajectories, or campaigns to build upon, that are not
            there or of no use.
        NotFound: its settings name an analysis or episode that is not there.
    """
    spec = campaign.spec
    steps = horizon(spec)
    return LearnerContext(
        seed=learner_seed(spec.seed),
        episodes=spec.episodes,
        horizon=steps,
        trajectories=stack(trajectories(search(spec), store), steps),
        predecessors=predecessors(spec, store),
        experience=experience(spec, store),
    )


def check_references(spec: CampaignSpec, store: Store) -> CampaignSpec:
    """The spec itself, once the analysis and campaigns that its settings name can be used.

    Raises:
        InvalidValue: one is not there; or it is to be built upon and has not ended, has learnt
            nothing, or has episodes of another length.
    """
    check_replayed(search(spec), store)
    predecessors(spec, store)
    data_campaigns(spec, store)
    return spec


def check_replayed(found: Search, store: Store) -> None:
    """Make sure that an analysis or campaign whose noise is replayed is there.

    Raises:
        InvalidValue: there is no such analysis or campaign.
    """
    finders = {"analysis": store.analyses.get, "campaign": store.campaigns.get}
    for name in finders.keys() & found.settings.keys():
        wanted = found.settings[name]
        try:
            if wanted is not None:
                finders[name](wanted)
        except NotFound as error:
            raise InvalidValue(f"{found.field}.{name}", error.problem, error.remedy) from error


def trajectories(found: Search, store: Store) -> Sequence[Floats]:
    """The noise trajectories that a method's settings name; none if they name none."""
    for name, find in FINDERS.items():
        if name != LEARNERS.get(found.method) and found.settings.get(name) is not None:
            return find(found.settings, store)
    return ()


def eigenfailures(settings: Mapping[str, Any], store: Store) -> Sequence[Floats]:
    """The eigenfailures of the analysis in the settings."""
    analysis = store.analyses.get(settings["analysis"])
    if analysis.result is None:
        problem = f"analysis {analysis.id} is {analysis.state} and has no eigenfailures."
        raise InvalidValue("settings.analysis", problem, "Wait for it, or launch another.")
    return [mode.eigenfailure for mode in analysis.result.modes]


def recorded(settings: Mapping[str, Any], store: Store) -> Sequence[Floats]:
    """The noise of episodes of another campaign: those listed, or all of its failures."""
    campaign, episodes = settings["campaign"], settings.get("episodes")
    if not episodes:
        return store.episodes.failures(campaign).noise
    return [store.episodes.get(campaign, index).noise.z for index in episodes]


FINDERS: dict[str, Callable[[Mapping[str, Any], Store], Sequence[Floats]]] = {
    "analysis": eigenfailures,
    "campaign": recorded,
}
