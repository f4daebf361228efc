"""Noise trajectories that campaigns ran and analyses found, as a method's settings name them."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from eigenfail.contracts import Store
from eigenfail.errors import InvalidValue
from eigenfail.values import Analysis, FailureMode, Floats, ReplayKind
from eigenfail_services.campaigns.earlier import Search
from eigenfail_services.campaigns.predecessors import LEARNERS


def trajectories(found: Search, store: Store) -> Sequence[Floats]:
    """The noise trajectories that a method's settings name; none if they name none."""
    for name, find in FINDERS.items():
        if name != LEARNERS.get(found.method) and found.settings.get(name) is not None:
            return find(found.settings, store)
    return ()


def analysed(settings: Mapping[str, Any], store: Store) -> Sequence[Floats]:
    """What the settings name of an analysis: of each kind all modes, or the one they name."""
    analysis = store.analyses.get(settings["analysis"])
    modes = chosen_modes(analysis, settings)
    kinds = settings.get("what") or (ReplayKind.EIGENFAILURE,)
    return [noise for kind in kinds for noise in KINDS[ReplayKind(kind)](analysis, modes, store)]


def chosen_modes(analysis: Analysis, settings: Mapping[str, Any]) -> Sequence[FailureMode]:
    """The modes of an analysis, or those whose numbers settings name, counted from 1.

    Raises:
        InvalidValue: it is not done, or has no such mode.
    """
    if analysis.result is None:
        problem = f"analysis {analysis.id} is {analysis.state} and has no eigenfailures."
        raise InvalidValue("settings.analysis", problem, "Wait for it, or launch another.")
    modes = analysis.result.modes
    field = "mode" if settings.get("mode") is not None else "modes"
    numbers = (settings["mode"],) if field == "mode" else settings.get("modes", ())
    for number in numbers:
        if number > len(modes):
            problem = f"analysis {analysis.id} has {len(modes)} modes, and none of number {number}."
            raise InvalidValue(f"settings.{field}", problem, "They are counted from 1.")
    return [modes[number - 1] for number in numbers] if numbers else modes


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
