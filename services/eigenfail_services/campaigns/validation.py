"""What a campaign must be before it is taken on: names known, values within bounds, noise there."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from math import ceil, isfinite
from typing import TYPE_CHECKING, Any

import msgspec
from msgspec.structs import replace

from eigenfail.bridges import BridgeOffer
from eigenfail.contracts import Injection, Reference
from eigenfail.errors import InvalidValue, NotFound, UnknownName, is_unsafe
from eigenfail.settings import LARGEST_INTEGER, convert, list_values
from eigenfail.values import CampaignSpec
from eigenfail.values.campaign_spec import RESULT_RULES
from eigenfail.values.learning import IN_FLIGHT, MOST_OPEN_ROUNDS
from eigenfail.values.variation import KINDS
from eigenfail.worlds import CampaignWorld, list_simulators, world_of
from eigenfail_services.campaigns import resolution
from eigenfail_services.campaigns.rounds import limit_lookahead
from eigenfail_services.methods import check_budget

if TYPE_CHECKING:  # a spec is checked without SQLAlchemy, which takes its time to load
    from eigenfail_services.store import Store

FAILURE_SETTINGS = ("campaign", "episode", "analysis", "mode")
"""Settings that name one failure: the first two together, or the last two."""


def validate_campaign(spec: CampaignSpec, store: "Store") -> resolution.ResolvedCampaign:
    """Resolve a campaign that can be launched if the connected bridges offer what it needs.

    Raises:
        UnknownName: a plug-in, setting or parameter that does not exist; the known ones are listed.
        InvalidValue: a value that cannot be; or an earlier campaign, an analysis or an episode that
            the settings name does not exist or is of no use.
    """
    return check_references(check_spec(spec), store)


def list_offers(
    campaigns: Iterable[resolution.ResolvedCampaign], store: "Store"
) -> tuple[BridgeOffer, ...]:
    """Return the known offers of bridges, if any of the campaigns needs a bridge."""
    needed = any(world_of(each.spec.simulator).needs_bridge for each in campaigns)
    return store.roster.list_offers() if needed else ()


def check_offers(campaign: resolution.ResolvedCampaign, offers: Iterable[BridgeOffer]) -> None:
    """Check that each bridge offers what a campaign needs, if it needs one.

    A worker whose bridge does not would decline the campaign, which is then paused. Without a known
    offer, that is how it is checked.

    Raises:
        UnknownName: a scenario, planner, parameter, setting, channel or signal that a bridge does
            not offer; the known ones are listed.
        InvalidValue: the bridge's scenario has fewer steps, or steps of another duration.
    """
    world = world_of(campaign.spec.simulator)
    for offer in offers:
        world.check_offer(campaign.spec, offer)


def check_spec(spec: CampaignSpec) -> resolution.ResolvedCampaign:
    """Resolve a campaign whose values are all known to make sense; references are not looked for.

    Nothing heavy is loaded for it: neither the simulator nor what methods train with.

    Raises:
        UnknownName: a plug-in, setting or parameter that does not exist; the known ones are listed.
        InvalidValue: a value of the wrong type, outside its bounds, or not a finite number; a
            budget that the method cannot begin with; or a function that may not be run here.
    """
    _refuse_unstorable(spec)
    convert(msgspec.to_builtins(spec), CampaignSpec)
    if spec.simulator not in list_simulators():
        raise UnknownName("simulator", spec.simulator, list_simulators())
    method = resolution.resolve_method(spec.method, spec.settings)
    check_budget(method.settings, spec.episodes)
    searching = resolution.find_searching(method)
    if spec.stop.cv is not None:
        resolution.check_estimates(searching, "stop.cv")
    world = world_of(spec.simulator)
    world.check(spec)
    if (resolved_model := world.resolve_disturbance(spec)) != spec.disturbance:
        spec = replace(spec, disturbance=resolved_model)
    if (named := world.resolve_requirements(spec)) != spec.requirements:
        spec = replace(spec, requirements=named)
    if searching.traits.needs_course:
        _check_course(spec, world)
    if spec.disturbance.searched_parameters and spec.settings.get("scale", 1.0) != 1.0:
        problem = "noise with a channel of the scenario, scaled, is of another scenario."
        raise InvalidValue("settings.scale", problem, "Replay it at scale 1.")
    resolved = resolution.make_resolved_campaign(spec, method, searching)
    if spec.parallel is not None:
        _check_parallel(resolved, spec.parallel)
    return resolved


def _check_parallel(campaign: resolution.ResolvedCampaign, parallel: int) -> None:
    """Raises InvalidValue where a method waits for each round, or would have too many open."""
    searching = campaign.searching
    if not searching.traits.tolerates_delay:
        raise InvalidValue(
            "parallel",
            f"{searching.name} decides itself how many episodes are open at a time: it needs the "
            "results of a round before it proposes the next one.",
            "Leave it out; to keep more workers busy, run several seeds side by side.",
        )
    pace = find_pace(campaign)
    if pace is None:
        return
    if pace.width is not None:
        _check_chains(campaign, pace.width, parallel)
    if pace.ahead >= MOST_OPEN_ROUNDS:
        opened = ceil(IN_FLIGHT * parallel)
        raise InvalidValue(
            "parallel",
            f"To keep {parallel} workers busy, {opened} episodes are open at a time, and "
            f"{MOST_OPEN_ROUNDS} rounds of {pace.later} hold no more than "
            f"{MOST_OPEN_ROUNDS * pace.later}.",
            f"Set {pace.setting} to {ceil(opened / MOST_OPEN_ROUNDS)} or more.",
        )


def _check_chains(campaign: resolution.ResolvedCampaign, chains: int, parallel: int) -> None:
    """Raises InvalidValue where chains are too few, or would be kept waiting by a stop rule."""
    name = campaign.searching.name
    if parallel > chains:
        raise InvalidValue(
            "parallel",
            f"{name} has no more than {chains} chains here, each of which moves an episode at a "
            f"time: {parallel} workers would wait for them.",
            f"Set it to {chains} or less; to keep more workers busy, run several seeds side by "
            "side.",
        )
    if campaign.spec.stop.judges_results:
        raise InvalidValue(
            "parallel",
            f"with a stop rule on results two groups of the chains of {name} would be open at a "
            "time, and without parallel all of them are.",
            "Leave out one of the two.",
        )


def _check_course(spec: CampaignSpec, world: CampaignWorld) -> None:
    """Raises InvalidValue where no episode can continue another one from a step on."""
    if not world.has_road:
        raise InvalidValue(
            "method",
            f"{spec.method} continues episodes from a step on, and functions have no steps.",
            "Take subset or mixture.",
        )
    if varied := list_varied(spec):
        raise InvalidValue(
            "scenario_parameters",
            f"{spec.method} continues episodes from a step on, and with {', '.join(varied)} drawn "
            "for each episode none is like another.",
            "Give fixed values, or take method monte_carlo.",
        )


def _refuse_unstorable(spec: CampaignSpec) -> None:
    """Raises InvalidValue for numbers and text that terminals and databases choke on."""
    for path, value in list_values(spec):
        if isinstance(value, float) and not isfinite(value):
            raise InvalidValue(path, f"{value} is not a finite number.")
        if isinstance(value, int) and abs(value) > LARGEST_INTEGER:
            raise InvalidValue(path, f"{value} is larger than 64 bits hold.")
        if isinstance(value, str) and any(map(is_unsafe, value)):
            problem = "contains a control character or an invisible one."
            raise InvalidValue(path, problem, "Take it out.")


def check_references(
    campaign: resolution.ResolvedCampaign, store: "Store"
) -> resolution.ResolvedCampaign:
    """Return the campaign with its references, once what its settings name can be used.

    Raises:
        InvalidValue: one does not exist; or it is to be built upon and has not ended, has learnt
            nothing, or has episodes of another length.
    """
    _check_named(campaign, store)
    if check := INJECTION_CHECKS.get(campaign.searching.traits.injects):
        check(campaign, store)
    return resolution.find_references(campaign, store)


def _check_named(campaign: resolution.ResolvedCampaign, store: "Store") -> None:
    """Raises InvalidValue where noise that is to be injected is not there, or does not fit."""
    method = campaign.searching
    for name, number in method.given_references(Reference.NOISE).items():
        field = f"{method.field}.{name}"
        try:
            source = store.analyses.get(number).campaign if name == "analysis" else number
            before = store.campaigns.get(source)
        except NotFound as error:
            raise InvalidValue(field, error.problem, error.remedy) from error
        resolution.check_channels(before, field, campaign.channels)


def _check_trajectories(campaign: resolution.ResolvedCampaign, store: "Store") -> None:
    """Check that the noise that a replay names exists.

    The failures of a whole campaign are not read: their number is not bounded.

    Raises:
        InvalidValue: nothing is named; or the analysis is not done, or has no mode or not the one
            that is named; or an episode has no result.
    """
    method = campaign.searching
    settings = method.given
    if all(settings.get(name) is None for name in resolution.READERS):
        problem = "they name neither an analysis nor a campaign whose noise is replayed."
        raise InvalidValue(method.field, problem, 'Give "analysis", or "campaign".')
    if settings.get("analysis") is None and not settings.get("episodes"):
        return
    try:
        known = resolution.read_trajectories(method, store)
    except NotFound as error:
        raise InvalidValue(f"{method.field}.episodes", error.problem, error.remedy) from error
    if not known:
        problem = "that analysis found no failure mode to replay."
        raise InvalidValue(f"{method.field}.analysis", problem, "Name one that has failure modes.")


def _check_failure(campaign: resolution.ResolvedCampaign, store: "Store") -> None:
    """Make sure that one failure is named, and that all replays will be in its scenario.

    Raises:
        InvalidValue: it is not exactly one; there is no such episode or mode; the episode did not
            end in a collision; or the scenario's parameters vary.
    """
    method = campaign.searching
    settings = method.given
    named = {name for name in FAILURE_SETTINGS if settings.get(name) is not None}
    if named not in ({"campaign", "episode"}, {"analysis", "mode"}):
        words = ", ".join(sorted(named)) or "nothing"
        remedy = 'Give "campaign" and "episode", or "analysis" and "mode", and nothing else.'
        raise InvalidValue(method.field, f"they name {words}, which is not one failure.", remedy)
    if "episode" in named:
        field = f"{method.field}.episode"
        _check_collision(settings["campaign"], settings["episode"], field, store)
    resolution.read_trajectories(method, store)
    for name in campaign.spec.disturbance.searched_parameters:
        problem = "is chosen by the noise, and minimal takes noise away that could be without."
        remedy = f"Leave out the channel scenario.{name}, and give the parameter a value."
        raise InvalidValue(f"scenario_parameters.{name}", problem, remedy)
    for name in list_varied(campaign.spec):
        raise InvalidValue(
            f"scenario_parameters.{name}",
            "varies, so that each replay would be in another scenario than the failure.",
            "`eigenfail episode shrink CAMPAIGN/EPISODE` fixes what the episode drew; or give a"
            " value, for a mode that of its medoid.",
        )


def _check_collision(campaign: int, episode: int, field: str, store: "Store") -> None:
    try:
        result = store.episodes.get(campaign, episode)
    except NotFound as error:
        raise InvalidValue(field, error.problem, error.remedy) from error
    if not result.is_failure:
        problem = f"episode {campaign}/{episode} is {result.outcome.word}, not a collision."
        remedy = f"`eigenfail episode list {campaign} --outcome collision` lists failures."
        raise InvalidValue(field, problem, remedy)


def _check_failures(campaign: resolution.ResolvedCampaign, store: "Store") -> None:
    """Check that the named campaign has failures that can be injected here.

    Raises:
        InvalidValue: it has not ended, has no failure, or has episodes of another length.
    """
    field = f"{campaign.searching.field}.campaign"
    before = resolution.find_ended(campaign.searching.given["campaign"], field, store)
    if not before.counts.failures:
        problem = f"campaign {before.id} has no failure to start from."
        raise InvalidValue(field, problem, "Name a campaign with failures, such as one of ast.")
    resolution.check_horizon(before, field, campaign.horizon)


INJECTION_CHECKS: Mapping[Injection, Callable[[resolution.ResolvedCampaign, "Store"], None]] = {
    Injection.FAILURES: _check_failures,
    Injection.ONE_FAILURE: _check_failure,
    Injection.TRAJECTORIES: _check_trajectories,
}


def list_varied(spec: CampaignSpec) -> tuple[str, ...]:
    """Return the scenario parameters that have a distribution."""
    given = spec.scenario_parameters.items()
    return tuple(name for name, value in given if is_distribution(value))


def list_drawn(spec: CampaignSpec) -> tuple[str, ...]:
    """Return the scenario parameters that each episode draws from its seed, not by its noise."""
    searched = spec.disturbance.searched_parameters
    return tuple(name for name in list_varied(spec) if name not in searched)


def is_distribution(value: Any) -> bool:
    """Return whether a scenario parameter is drawn for each episode."""
    return isinstance(value, dict) and not KINDS.keys().isdisjoint(value)


class RoundPace(msgspec.Struct, frozen=True):
    """The size of a method's rounds, and how many are open at a time.

    Attributes:
        first: episodes of its first round.
        later: episodes of the largest round after that.
        ahead: rounds that are open besides the oldest one.
        setting: what makes rounds smaller.
        width: episodes that can be open at a time for most of a campaign; None: any number.
    """

    first: int
    later: int
    ahead: int
    setting: str
    width: int | None = None


def describe_stop_rules(campaign: resolution.ResolvedCampaign) -> Iterator[str]:
    """Return how late a campaign's stop rules may take effect, in sentences."""
    spec = campaign.spec
    rules = {name: limit for name, limit in spec.stop.given().items() if name in RESULT_RULES}
    if not rules:
        return
    several = len(rules) > 1
    limits = ", ".join(f"{name} = {limit:g}" for name, limit in rules.items())
    subject = f"The rules {limits} are" if several else f"The rule {limits} is"
    judged = f"{subject} judged after whole rounds"
    holds, pace = "one holds" if several else "it holds", find_pace(campaign)
    if pace is None:
        yield f"{judged}, as large as the method makes them: once {holds}, open ones are finished."
    elif spec.episodes <= pace.first + pace.ahead * pace.later:
        yield f"{judged}, and {_describe_whole(pace)}: nothing ends early. {_describe_remedy(pace)}"
    else:
        rest = _describe_rest(pace, spec.episodes)
        yield f"{judged}, of {_describe_size(pace)} episodes here: once {holds}, {rest}"


def _describe_whole(pace: RoundPace) -> str:
    if pace.ahead:
        return "two rounds, which are open together, hold all of the budget"
    return "one round holds all of the budget"


def _describe_remedy(pace: RoundPace) -> str:
    return f"Give it more episodes, or a smaller {pace.setting}."


def _describe_size(pace: RoundPace) -> str:
    return f"{pace.later}" if pace.first == pace.later else f"up to {max(pace.first, pace.later)}"


def _describe_rest(pace: RoundPace, episodes: int) -> str:
    open_then = (1 + pace.ahead) * max(pace.first, pace.later) - 1
    why = ", as the next round is open by then" if pace.ahead else ""
    return f"up to {min(open_then, episodes - 1)} more are run{why}."


def find_pace(campaign: resolution.ResolvedCampaign) -> RoundPace | None:
    """Return the round sizes of the method, or of an ensemble's members; None if unknown."""
    searching = campaign.searching
    # How many learners share the episodes.
    members = getattr(campaign.method.settings, "members", 1)
    episodes = ceil(campaign.spec.episodes / members)
    sizes = searching.description.find_round_sizes(searching.settings, episodes)
    if sizes is None:
        return None
    wanted = searching.description.count_rounds_ahead(campaign.spec.parallel, sizes.later)
    ahead = limit_lookahead(wanted, campaign.spec.stop)
    setting = f"{searching.field}.{sizes.setting}"
    width = None if sizes.width is None else members * sizes.width
    return RoundPace(sizes.first, sizes.later, ahead, setting, width)
