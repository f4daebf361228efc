"""What a learner is born with: made from the campaign, and from what the store holds."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from eigenfail.contracts import Store
from eigenfail.errors import InvalidValue, NotFound
from eigenfail.values import (
    Analysis,
    Campaign,
    CampaignSpec,
    FailureMode,
    Floats,
    LearnerContext,
    ReplayKind,
    learner_seed,
)
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
    check_failure(search(spec), store)
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


def check_failure(found: Search, store: Store) -> None:
    """Make sure that a single failure that settings name is one.

    Raises:
        InvalidValue: there is no such episode or mode, or the episode did not end in a collision.
    """
    episode, campaign = found.settings.get("episode"), found.settings.get("campaign")
    if episode is not None and campaign is not None:
        check_collision(campaign, episode, f"{found.field}.episode", store)
    if found.settings.get("mode") is not None:
        trajectories(found, store)


def check_collision(campaign: int, episode: int, field: str, store: Store) -> None:
    """Make sure that an episode is a failure.

    Raises:
        InvalidValue: it has no result, or did not end in a collision.
    """
    try:
        result = store.episodes.get(campaign, episode)
    except NotFound as error:
        raise InvalidValue(field, error.problem, error.remedy) from error
    if not result.is_failure:
        problem = f"episode {campaign}/{episode} ended {result.outcome}, not in a collision."
        remedy = f"`eigenfail episode list {campaign} --outcome collision` lists failures."
        raise InvalidValue(field, problem, remedy)


def trajectories(found: Search, store: Store) -> Sequence[Floats]:
    """The noise trajectories that a method's settings name; none if they name none."""
    for name, find in FINDERS.items():
        if name != LEARNERS.get(found.method) and found.settings.get(name) is not None:
            return find(found.settings, store)
    return ()


def analysed(settings: Mapping[str, Any], store: Store) -> Sequence[Floats]:
    """What the settings name of an analysis: of each kind all modes, or the one they name."""
    analysis = store.analyses.get(settings["analysis"])
    modes = chosen_modes(analysis, settings.get("mode"))
    kinds = settings.get("what") or (ReplayKind.EIGENFAILURE,)
    return [noise for kind in kinds for noise in KINDS[ReplayKind(kind)](analysis, modes, store)]


def chosen_modes(analysis: Analysis, number: int | None) -> Sequence[FailureMode]:
    """The modes of an analysis, or the one of a number, counted from 1.

    Raises:
        InvalidValue: it is not done, or has no such mode.
    """
    if analysis.result is None:
        problem = f"analysis {analysis.id} is {analysis.state} and has no eigenfailures."
        raise InvalidValue("settings.analysis", problem, "Wait for it, or launch another.")
    modes = analysis.result.modes
    if number is None:
        return modes
    if number > len(modes):
        problem = f"analysis {analysis.id} has {len(modes)} modes, and none of number {number}."
        raise InvalidValue("settings.mode", problem, "They are counted from 1.")
    return (modes[number - 1],)


def eigenfailures(_a: Analysis, modes: Sequence[FailureMode], _s: Store) -> list[Floats]:
    """The eigenfailure of each mode."""
    return [mode.eigenfailure for mode in modes]


def medoids(analysis: Analysis, modes: Sequence[FailureMode], store: Store) -> list[Floats]:
    """The noise of each mode's medoid."""
    places = ((mode.medoid_campaign or analysis.campaign, mode.medoid) for mode in modes)
    return [store.episodes.get(*place).noise.z for place in places]


KINDS: dict[ReplayKind, Callable[[Analysis, Sequence[FailureMode], Store], list[Floats]]] = {
    ReplayKind.EIGENFAILURE: eigenfailures,
    ReplayKind.MEDOID: medoids,
}


def recorded(settings: Mapping[str, Any], store: Store) -> Sequence[Floats]:
    """The noise of episodes of another campaign: those listed, or all of its failures."""
    campaign, episode = settings["campaign"], settings.get("episode")
    episodes = settings.get("episodes") if episode is None else (episode,)
    if not episodes:
        return store.episodes.failures(campaign).noise
    return [store.episodes.get(campaign, index).noise.z for index in episodes]


FINDERS: dict[str, Callable[[Mapping[str, Any], Store], Sequence[Floats]]] = {
    "analysis": analysed,
    "campaign": recorded,
}
