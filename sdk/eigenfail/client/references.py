"""Ids and paths of campaigns, episodes and others, which callers give as ids or as objects."""

from collections.abc import Iterable, Mapping
from operator import index as convert_index
from pathlib import Path
from types import MappingProxyType
from typing import Any, SupportsIndex

from eigenfail.errors import InvalidValue
from eigenfail.values.access import ApiKey, NewKey
from eigenfail.values.analysis import Analysis, FailureMode, Mode
from eigenfail.values.campaign import Campaign
from eigenfail.values.episode import EpisodeResult
from eigenfail.values.operations import Event
from eigenfail.values.records import EpisodeDetail, EpisodeRow
from eigenfail.values.suite import SuiteRow, SuiteStanding
from eigenfail.values.summary import Summary

CampaignLike = SupportsIndex | Campaign | Summary | SuiteRow | EpisodeRow | EpisodeDetail
"""A campaign: its id, or an object that is the campaign or belongs to it."""

CampaignsLike = CampaignLike | Iterable[CampaignLike]
"""One campaign, or several, such as those of a list."""

EpisodeLike = SupportsIndex | EpisodeRow | EpisodeResult
"""An episode of a campaign that is named beside it: its index, or the episode."""

AnalysisLike = SupportsIndex | Analysis | Mode
"""An analysis: its id, or an object that is the analysis or belongs to it."""

ModeLike = SupportsIndex | Mode | FailureMode
"""A failure mode of an analysis that is named beside it: its number, from 1, or the mode."""

KeyLike = SupportsIndex | ApiKey | NewKey
"""A key: its id, or the key."""

EventLike = SupportsIndex | Event
"""An event: its id, or the event."""

SuiteLike = str | SuiteStanding
"""A suite that the service knows: its name, or the suite."""

_CAMPAIGN_FIELDS: Mapping[type, str] = MappingProxyType(
    {
        Campaign: "id",
        Summary: "campaign",
        SuiteRow: "campaign",
        EpisodeRow: "campaign",
        EpisodeDetail: "campaign",
    }
)


def find_campaign_id(campaign: CampaignLike) -> int:
    """Return the id of a campaign.

    Raises:
        InvalidValue: the value is neither an id nor an object of a campaign, or is an episode that
            does not state its campaign.
    """
    if isinstance(campaign, EpisodeResult) and _get_campaign(campaign) is None:
        raise InvalidValue(
            "campaign",
            f"the {type(campaign).__name__} does not say its campaign.",
            "Give campaign and index, or the row of a list of episodes.",
        )
    return _find_id("campaign", campaign, _CAMPAIGN_FIELDS)


def find_campaign_ids(campaigns: CampaignsLike) -> tuple[int, ...]:
    """Return the ids of campaigns, in their order.

    Raises:
        InvalidValue: no campaign is named, or one is neither an id nor an object of a campaign.
    """
    # Lists of a client are iterable, too: `compare(client.campaigns.list(), 1)` needs no ids.
    named = campaigns if isinstance(campaigns, Iterable) else (campaigns,)
    if not (ids := tuple(map(find_campaign_id, named))):
        raise InvalidValue("campaigns", "none is named.", "Name at least one.")
    return ids


def find_episode_id(campaign: CampaignLike, index: EpisodeLike | None) -> tuple[int, int]:
    """Return campaign and index of an episode.

    Args:
        campaign: its campaign; or the episode itself, as listed.
        index: the episode; None if `campaign` is the episode.

    Raises:
        InvalidValue: a value is neither an id nor such an object, the index is missing, or the
            episode belongs to another campaign.
    """
    number = find_campaign_id(campaign)
    if index is None:
        if not isinstance(campaign, EpisodeRow | EpisodeDetail):
            raise InvalidValue("index", "is missing.", "Name the index of the episode.")
        index = campaign
    owner = _get_campaign(index)
    if owner is not None and owner != number:
        problem = f"the episode belongs to campaign {owner}, not to {number}."
        raise InvalidValue("index", problem, "Name its own campaign.")
    return number, _find_id("index", index, {EpisodeRow: "index", EpisodeResult: "index"})


def locate_campaign(campaign: CampaignLike) -> str:
    """Return the path of a campaign in the API; raises as `find_campaign_id` does."""
    return f"/campaigns/{find_campaign_id(campaign)}"


def split_text(
    parameter: str, item: EpisodeLike | ModeLike | str | Path | None, text: object
) -> tuple[Any, str | Path]:
    """Return the item and the text that follow the first argument of a call.

    An episode or mode that states its campaign or analysis may be the only object:
    `(row, "failure.gif")` means `(campaign, index, "failure.gif")`. The returned item is then None.

    Args:
        parameter: name of the text.
        item: second argument of the call; the text, if the first argument is the only object.
        text: third argument of the call; None if the second argument is the text.

    Raises:
        InvalidValue: the text is missing or is not a text.
    """
    if text is None and isinstance(item, str | Path):
        return None, item
    if not isinstance(text, str | Path):
        given = "is missing" if text is None else f"is an object of type {type(text).__name__}"
        raise InvalidValue(parameter, f"{given}.", "Give it as text behind what it belongs to.")
    return item, text


def locate_episode(campaign: CampaignLike, index: EpisodeLike | None) -> str:
    """Return the path of an episode in the API; raises as `find_episode_id` does."""
    number, of_episode = find_episode_id(campaign, index)
    return f"/campaigns/{number}/episodes/{of_episode}"


def locate_analysis(analysis: AnalysisLike) -> str:
    """Return the path of an analysis in the API.

    Raises:
        InvalidValue: the value is neither an id nor an object of an analysis.
    """
    number = _find_id("analysis", analysis, {Analysis: "id", Mode: "analysis"})
    return f"/analyses/{number}"


def locate_mode(analysis: AnalysisLike, mode: ModeLike | None = None) -> str:
    """Return the path of a failure mode in the API.

    Args:
        analysis: its analysis; or the mode itself, as listed.
        mode: the mode; None if `analysis` is the mode.

    Raises:
        InvalidValue: a value is neither an id nor such an object, the mode is missing, or it
            belongs to another analysis.
    """
    if mode is None:
        if not isinstance(analysis, Mode):
            raise InvalidValue("mode", "is missing.", "Name the number of the mode, from 1.")
        mode = analysis
    return f"{locate_analysis(analysis)}/modes/{_find_mode_number(analysis, mode)}"


def locate_key(key: KeyLike) -> str:
    """Return the path of a key in the API.

    Raises:
        InvalidValue: the value is neither an id nor a key.
    """
    of_key = key.key if isinstance(key, NewKey) else key
    return f"/keys/{_find_id('key', of_key, {ApiKey: 'id'})}"


def find_event_id(event: EventLike) -> int:
    """Return the id of an event.

    Raises:
        InvalidValue: the value is neither an id nor an event.
    """
    return _find_id("event", event, {Event: "id"})


def find_suite_name(suite: SuiteLike) -> str:
    """Return the name of a suite."""
    return suite if isinstance(suite, str) else suite.name


def _find_mode_number(analysis: AnalysisLike, mode: ModeLike) -> int:
    if isinstance(mode, Mode) and locate_analysis(mode) != locate_analysis(analysis):
        problem = f"the mode belongs to analysis {mode.analysis}."
        raise InvalidValue("mode", problem, "Name its own analysis.")
    return _find_id("mode", mode, {Mode: "number", FailureMode: "number"})


def _get_campaign(episode: object) -> int | None:
    """Return the id of the campaign that an object of an episode states."""
    return episode.campaign if isinstance(episode, EpisodeRow | EpisodeDetail) else None


def _find_id(parameter: str, given: object, fields: Mapping[type, str]) -> int:
    for kind, field in fields.items():
        if isinstance(given, kind):
            found: int = getattr(given, field)
            return found
    # numpy's integers are indices, too. True would be campaign 1.
    if isinstance(given, SupportsIndex) and not isinstance(given, bool):
        return convert_index(given)
    known = ", ".join(kind.__name__ for kind in fields)
    # The repr of a value with many fields would be cut off in the middle of them.
    is_plain = given is None or isinstance(given, str | float | bool)
    named = f"{given!r:.80}" if is_plain else f"an object of type {type(given).__name__}"
    problem = f"{named} is neither an id nor one of {known}."
    raise InvalidValue(parameter, problem, "Give the id or the object.")
