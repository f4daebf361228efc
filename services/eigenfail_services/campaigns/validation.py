"""Campaigns with their plug-ins loaded and their settings read, and all checks of a spec alone.

References to earlier campaigns are checked in `references`; `drafts` does both.
"""

import contextlib
from collections.abc import Callable, Iterable, Iterator
from functools import lru_cache
from math import ceil, isfinite
from typing import Any

import msgspec
from msgspec.structs import replace

from eigenfail.bridges import BridgeOffer
from eigenfail.errors import EigenfailError, InvalidValue, is_unsafe
from eigenfail.settings import LARGEST_INTEGER, convert, list_values
from eigenfail.values.campaign_spec import RESULT_RULES, CampaignSpec
from eigenfail.values.learning import IN_FLIGHT, MOST_OPEN_ROUNDS
from eigenfail.values.variation import KINDS
from eigenfail.worlds import CampaignWorld, world_of
from eigenfail_services import resolution
from eigenfail_services.campaigns.rounds import limit_lookahead
from eigenfail_services.methods import Particular, check_budget

MOST_SPECS = 2_000
"""Specs whose defaults are kept. A page of releases reads as many campaigns, most of them alike."""


def fill_defaults(spec: CampaignSpec) -> CampaignSpec:
    """Return the spec with the defaults of its method, planner and scenario written out.

    Two specs become equal if they differ only in the defaults that they write out. A plug-in that
    is not installed here, or that has changed since and refuses the settings, leaves its part
    unchanged.
    """
    return _fill_written(msgspec.json.encode(spec, order="deterministic"))


# Reading the settings types of plug-ins takes most of the time of a comparison, and campaigns that
# are compared are mostly written alike: so specs are kept by their text.
@lru_cache(maxsize=MOST_SPECS)
def _fill_written(written: bytes) -> CampaignSpec:
    spec = msgspec.json.decode(written, type=CampaignSpec)
    world = world_of(spec.simulator)
    for fill in (_fill_method, world.fill_planner, world.fill_scenario):
        with contextlib.suppress(EigenfailError):
            spec = fill(spec)
    return spec


def _fill_method(spec: CampaignSpec) -> CampaignSpec:
    settings = resolution.resolve_method(spec.method, spec.settings).settings
    return replace(spec, settings=msgspec.to_builtins(settings))


def check_estimates(
    method: resolution.ResolvedMethod, field: str, *, of_exploits: bool = False
) -> None:
    """Make sure that a method estimates a probability under its settings.

    Args:
        method: method with its settings.
        field: the field that requires the probability.
        of_exploits: the probability must come from proposals that the method makes without learning
            on.

    Raises:
        InvalidValue: it makes no estimate.
    """
    known, settings = method.description, method.settings
    if not (known.weighs if of_exploits else known.estimates):
        problem = f"{method.name} estimates no probability."
        raise InvalidValue(field, problem, "Leave this rule out, or take a method that does.")
    if isinstance(settings, Particular) and (why := settings.no_estimate()):
        problem = f"{method.name} estimates no probability here: {why}"
        raise InvalidValue(field, problem, "Or leave this rule out.")


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


def check_offers(
    campaign: resolution.ResolvedCampaign, list_offers: Callable[[], Iterable[BridgeOffer]]
) -> None:
    """Check that each bridge offers what a campaign needs, if it needs one.

    Otherwise a worker would decline the campaign, which is then paused. Without a known offer, only
    the worker checks it. Offers are listed only for a campaign that needs a bridge.

    Raises:
        UnknownName: a scenario, planner, parameter, setting, channel or signal that a bridge does
            not offer; the known ones are listed.
        InvalidValue: the bridge's scenario has fewer steps, or steps of another duration.
    """
    world = world_of(campaign.spec.simulator)
    for offer in list_offers() if world.needs_bridge else ():
        world.check_offer(campaign.spec, offer)


def check_spec(spec: CampaignSpec) -> resolution.ResolvedCampaign:
    """Resolve a campaign and check all of its values, but not its references.

    Nothing heavy is loaded for it: neither the simulator nor what methods train with.

    Raises:
        UnknownName: a plug-in, setting or parameter that does not exist; the known ones are listed.
        InvalidValue: a value of the wrong type, outside its bounds, or not a finite number; a
            budget that the method cannot begin with; or a function that may not be run here.
    """
    _refuse_unstorable(spec)
    # msgspec checks types and bounds only when it decodes: a spec that was made in Python has not
    # been checked.
    convert(msgspec.to_builtins(spec), CampaignSpec)
    world = world_of(spec.simulator)
    world.check(spec)
    method = resolution.resolve_method(spec.method, spec.settings)
    check_budget(method.settings, spec.episodes)
    searching = resolution.find_searching(method)
    references = resolution.find_references(searching)
    if spec.stop.cv is not None:
        check_estimates(searching, "stop.cv")
    spec, form = world.resolve(spec)
    if searching.traits.needs_course:
        _check_course(spec, world)
    if spec.disturbance.searched_parameters and spec.settings.get("scale", 1.0) != 1.0:
        problem = "noise with a channel of the scenario, scaled, is of another scenario."
        raise InvalidValue("settings.scale", problem, "Replay it at scale 1.")
    resolved = resolution.ResolvedCampaign(spec, form, references, method, searching)
    if spec.parallel is not None:
        _check_parallel(resolved, spec.parallel)
    return resolved


def _check_parallel(campaign: resolution.ResolvedCampaign, parallel: int) -> None:
    """Raise InvalidValue if a method waits for each round, or would have too many open."""
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
    """Raise InvalidValue if chains are too few, or would be kept waiting by a stop rule."""
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
    """Raise InvalidValue if no episode can continue another one from a step on."""
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
    """Raise InvalidValue for numbers and text that terminals or databases do not accept."""
    for path, value in list_values(spec):
        if isinstance(value, float) and not isfinite(value):
            raise InvalidValue(path, f"{value} is not a finite number.")
        if isinstance(value, int) and abs(value) > LARGEST_INTEGER:
            raise InvalidValue(path, f"{value} is larger than 64 bits hold.")
        if isinstance(value, str) and any(map(is_unsafe, value)):
            problem = "contains a control character or an invisible one."
            raise InvalidValue(path, problem, "Take it out.")


class RoundPace(msgspec.Struct, frozen=True):
    """The size of a method's rounds, and how many are open at a time.

    Attributes:
        first: episodes of its first round.
        later: episodes of the largest round after that.
        ahead: rounds that are open besides the oldest one.
        setting: the setting that makes rounds smaller.
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
        rounds = "one round holds"
        if pace.ahead:
            rounds = "two rounds, which are open together, hold"
        remedy = f"Give it more episodes, or a smaller {pace.setting}."
        yield f"{judged}, and {rounds} all of the budget: nothing ends early. {remedy}"
    else:
        largest = max(pace.first, pace.later)
        size = f"{largest}" if pace.first == pace.later else f"up to {largest}"
        # The round that a rule is judged after is over: one episode less than all open ones.
        open_then = min((1 + pace.ahead) * largest - 1, spec.episodes - 1)
        why = ", as the next round is open by then" if pace.ahead else ""
        more = f"up to {open_then} more are run{why}."
        yield f"{judged}, of {size} episodes here: once {holds}, {more}"


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
