"""One stored episode as a campaign of its own: its noise again, as it was or scaled."""

import msgspec

from eigenfail.contracts import Store
from eigenfail.errors import InvalidValue
from eigenfail.values import Campaign, EpisodeResult, StopRules
from eigenfail.values.campaign import LONGEST_NAME
from eigenfail.variations import drawn_for
from eigenfail_services.campaigns.checks import check_spec


def replay_episode(
    store: Store, campaign: int, index: int, scale: float, made_by: int | None = None
) -> Campaign:
    """Queue a campaign of one episode, whose scene is kept, in the scenario that the stored drew.

    Args:
        store: where the episode is.
        campaign: of the episode.
        index: of the episode.
        scale: of the noise; 1 injects it as it was.
        made_by: id of the key of whoever asks.

    Raises:
        NotFound: no such campaign, or the episode has no result yet.
        InvalidValue: the episode ended before its first step, so that there is no noise.
        UnknownName: a plug-in of the campaign is not installed here.
        QuotaExceeded: the key does not allow another campaign.
    """
    spec = store.campaigns.get(campaign).spec
    stored = store.episodes.get(campaign, index)
    refuse_silence(stored)
    scaled = f", noise × {scale:g}" if scale != 1.0 else ""
    wanted = msgspec.structs.replace(
        spec,
        name=f"{spec.name}: replay of {campaign}/{index}{scaled}"[-LONGEST_NAME:],
        method="replay",
        settings={"campaign": campaign, "episodes": [index], "scale": scale},
        episodes=1,
        stop=StopRules(),
        scene_every=1,
        scenario_parameters={**spec.scenario_parameters, **drawn_for(spec, stored.seed)},
    )
    return store.campaigns.create(check_spec(wanted), made_by=made_by)


def refuse_silence(stored: EpisodeResult) -> None:
    """Raises InvalidValue for an episode that ended before any noise was injected."""
    if not stored.steps:
        why = stored.fault.message if stored.fault else "no reason was kept"
        raise InvalidValue("episode", f"It has no noise to replay: {why}")
