"""Whether there is noise to be injected, where a method injects what was found before."""

from collections.abc import Callable

from eigenfail.contracts import Store
from eigenfail.errors import InvalidValue, NotFound
from eigenfail.values import CampaignSpec
from eigenfail_services.campaigns.earlier import Search, search
from eigenfail_services.campaigns.recorded_noise import FINDERS, trajectories
from eigenfail_services.campaigns.worlds import varied


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


def check_noise(spec: CampaignSpec, store: Store) -> None:
    """Make sure that there is noise to be injected, where a method injects what was found.

    Raises:
        InvalidValue: there is none, or not what the method takes.
    """
    found = search(spec)
    if check := NOISE_CHECKS.get(found.method):
        check(found, spec, store)


def check_replay(found: Search, _spec: CampaignSpec, store: Store) -> None:
    """Make sure that what is named for a replay is there.

    The failures of a whole campaign are not looked for: nobody knows how many there will be.

    Raises:
        InvalidValue: nothing is named; or the analysis is not done, or has no mode or not the one
            that is named; or an episode has no result.
    """
    settings = found.settings
    if all(settings.get(name) is None for name in FINDERS):
        problem = "they name neither an analysis nor a campaign whose noise is replayed."
        raise InvalidValue(found.field, problem, 'Give "analysis", or "campaign".')
    if settings.get("analysis") is None and not settings.get("episodes"):
        return
    try:
        known = trajectories(found, store)
    except NotFound as error:
        raise InvalidValue(f"{found.field}.episodes", error.problem, error.remedy) from error
    if not known:
        problem = "that analysis found no failure mode to replay."
        raise InvalidValue(f"{found.field}.analysis", problem, "Name one that has failure modes.")


def check_failure(found: Search, spec: CampaignSpec, store: Store) -> None:
    """Make sure that one failure is named, and that all replays will be in its scenario.

    Raises:
        InvalidValue: it is not exactly one; there is no such episode or mode; the episode did not
            end in a collision; or the scenario's parameters vary.
    """
    settings = found.settings
    named = {name for name in NAMES if settings.get(name) is not None}
    if named not in ({"campaign", "episode"}, {"analysis", "mode"}):
        told = ", ".join(sorted(named)) or "nothing"
        remedy = 'Give "campaign" and "episode", or "analysis" and "mode", and nothing else.'
        raise InvalidValue(found.field, f"they name {told}, which is not one failure.", remedy)
    if "episode" in named:
        check_collision(settings["campaign"], settings["episode"], f"{found.field}.episode", store)
    trajectories(found, store)
    refuse_varied(spec)


def refuse_varied(spec: CampaignSpec) -> None:
    """Raises InvalidValue where each replay of one failure would draw another scenario."""
    for name in varied(spec):
        raise InvalidValue(
            f"scenario_parameters.{name}",
            "varies, so that each replay would be in another scenario than the failure.",
            "`eigenfail episode shrink CAMPAIGN/EPISODE` fixes what the episode drew; or give a"
            " value, for a mode that of its medoid.",
        )


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


NAMES = ("campaign", "episode", "analysis", "mode")
"""Settings of `minimal` that name a failure: the first two together, or the last two."""

NOISE_CHECKS: dict[str, Callable[[Search, CampaignSpec, Store], None]] = {
    "minimal": check_failure,
    "replay": check_replay,
}
"""Methods that inject what was found before."""
