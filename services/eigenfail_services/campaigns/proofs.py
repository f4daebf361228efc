"""Proof by replay: modes injected again, where their failures happened and in other scenarios."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import product
from typing import Any, NamedTuple, get_args, get_type_hints

import msgspec

from eigenfail.errors import Conflict, InvalidValue
from eigenfail.values.analysis import Analysis, AnalysisResult
from eigenfail.values.campaign import FINAL_STATES, Campaign, CampaignState
from eigenfail.values.campaign_spec import LONGEST_NAME, CampaignSpec, StopRules
from eigenfail.values.episode import EpisodeResult, Outcome
from eigenfail.values.proof import (
    NearestFailure,
    Proof,
    ProvenMode,
    ProvenScenario,
    ReplayedNoise,
    ReplayKind,
    Reproduction,
)
from eigenfail.worlds import list_channels, world_of
from eigenfail_services.campaigns import validation
from eigenfail_services.campaigns.analysis_jobs import WORLD_FIELDS, read_world_field
from eigenfail_services.methods.nearest import MOST_EPISODES, place_trials
from eigenfail_services.resolution import ResolvedCampaign
from eigenfail_services.statistics.importance import expected_log_probability
from eigenfail_services.statistics.intervals import rate
from eigenfail_services.store.codec import spec_hash
from eigenfail_services.store.store import Store

REPLAY, NEAREST = "replay", "nearest"
"""Methods of the campaigns that are linked to an analysis."""


class ReplayWorld(NamedTuple):
    """The analysed campaign in one scenario, with the modes that happened there.

    Attributes:
        spec: spec of the campaign, in that scenario.
        modes: modes that are replayed there, from 0.
        drawn: the scenario's parameters that its modes' medoids drew; empty if none vary.
    """

    spec: CampaignSpec
    modes: tuple[int, ...]
    drawn: Mapping[str, Any]


def _list_worlds(store: Store, analysis: Analysis, result: AnalysisResult) -> list[ReplayWorld]:
    """Return the scenarios of an analysis's modes: one, unless the scenario's parameters vary.

    If they vary, each mode belongs to the scenario that its medoid drew; modes whose medoids drew
    the same parameters share a world.
    """
    analysed = store.campaigns.get(analysis.campaign).spec
    found: dict[bytes, ReplayWorld] = {}
    for place, mode in enumerate(result.modes):
        key = msgspec.json.encode(mode.drawn, order="deterministic")
        before = found.get(key, ReplayWorld(_put_parameters(analysed, mode.drawn), (), mode.drawn))
        found[key] = before._replace(modes=(*before.modes, place))
    return list(found.values())


def _put_parameters(spec: CampaignSpec, parameters: Mapping[str, Any]) -> CampaignSpec:
    together = {**spec.scenario_parameters, **parameters}
    return msgspec.structs.replace(spec, scenario_parameters=together)


def _refuse_several_worlds(store: Store, analysis: Analysis) -> None:
    """Make sure that all failures of an analysis are of one world.

    Raises:
        Conflict: its campaigns differ in their scenario, its parameters, planner or simulator.
    """
    numbers = (analysis.campaign, *analysis.settings.campaigns)
    first, *others = (_describe_world(store.campaigns.get(each).spec) for each in numbers)
    differing = [name for name in WORLD_FIELDS if any(each[name] != first[name] for each in others)]
    if differing:
        raise Conflict(
            f"Analysis {analysis.id} is of campaigns that differ in {', '.join(differing)}: there"
            " is no one scenario and planner to replay all of its modes with.",
            "Analyse each campaign by itself, and prove that analysis.",
        )


def _describe_world(spec: CampaignSpec) -> dict[str, Any]:
    fields = {name: read_world_field(spec, name) for name in WORLD_FIELDS}
    return fields | {"scenario_parameters": _fill_parameters(spec)}


def _fill_parameters(spec: CampaignSpec) -> dict[str, Any]:
    return world_of(spec.simulator).default_parameters(spec) | spec.scenario_parameters


def read_result(analysis: Analysis) -> AnalysisResult:
    """Return the result of an analysis.

    Raises:
        Conflict: it is not done.
    """
    if analysis.result is None:
        raise Conflict(
            f"Analysis {analysis.id} is {analysis.state}. {analysis.problem}".strip(),
            "Wait until it is done, or launch another.",
        )
    return analysis.result


def summarise_proof(store: Store, analysis: Analysis) -> Proof:
    """Return what the replays of an analysis have shown so far.

    Raises:
        Conflict: the analysis is not done.
    """
    result = read_result(analysis)
    linked = [store.campaigns.get(each) for each in store.analyses.replays(analysis.id)]
    # Proofs link searches for the nearest failing point, too.
    replays = [each for each in linked if each.spec.method == REPLAY]
    scenarios = tuple(
        _find_scenario(store, analysis, result, each) for each in _keep_latest(replays)
    )
    everything = [replay for scenario in scenarios for replay in scenario.replays]
    same = [replay for scenario in scenarios if scenario.is_same for replay in scenario.replays]
    searches = [each for each in linked if each.spec.method == NEAREST]
    nearest = _find_centres(same) | _find_nearest_points(store, analysis, result, searches)
    states = [*(each.state for each in scenarios), *(each.state for each in searches)]
    return Proof(
        analysis=analysis.id,
        done=bool(replays) and all(state in FINAL_STATES for state in states),
        reproduced=_count_reproductions(_count_kind(same, ReplayKind.EIGENFAILURE)),
        eigenfailures=_count_reproductions(_count_kind(everything, ReplayKind.EIGENFAILURE)),
        medoids=_count_reproductions(_count_kind(everything, ReplayKind.MEDOID)),
        modes=tuple(
            _summarise_mode(everything, mode, nearest.get(mode))
            for mode in range(len(result.modes))
        ),
        scenarios=scenarios,
        searches=tuple(each.id for each in searches),
        unplaced=tuple(
            each.mode
            for each in _count_kind(same, ReplayKind.EIGENFAILURE)
            if each.outcome is Outcome.SAFE and each.mode not in nearest
        ),
    )


def _find_centres(same: Iterable[ReplayedNoise]) -> dict[int, NearestFailure]:
    """Return, by mode, the centres that fail in the scenario of the mode's own failures."""
    return {
        each.mode: NearestFailure(0.0, each.campaign, each.index)
        for each in _count_kind(same, ReplayKind.EIGENFAILURE)
        if each.reproduced
    }


def _find_nearest_points(
    store: Store,
    analysis: Analysis,
    result: AnalysisResult,
    searches: Iterable[Campaign],
) -> dict[int, NearestFailure]:
    """Return the nearest failing points of the modes whose search has ended, by mode."""
    found: dict[int, NearestFailure] = {}
    for search in searches:
        if search.state is CampaignState.DONE:
            modes = [number - 1 for number in _list_modes(search.spec)]
            ended = store.episodes.finished(search.id, range(search.spec.episodes))
            results = sorted(ended, key=lambda each: each.index)
            trials = place_trials(len(modes), [each.is_failure for each in results])
            for place, mode in enumerate(modes):
                failing = [n for n, each in enumerate(trials) if each.mode == place and each.failed]
                nearest = min(failing, key=lambda n: trials[n].t, default=None)
                medoid = result.modes[mode]
                found[mode] = (
                    NearestFailure(1.0, medoid.medoid_campaign or analysis.campaign, medoid.medoid)
                    if nearest is None
                    else NearestFailure(trials[nearest].t, search.id, nearest)
                )
    return found


def _find_scenario(
    store: Store, analysis: Analysis, result: AnalysisResult, replay: Campaign
) -> ProvenScenario:
    """Return the results of a replay campaign, from the cache unless more episodes have ended.

    Stored results never change, and each new result changes the counts.
    """
    return store.answers.get(
        ("proof in a scenario", analysis.id, replay.id),
        (replay.state, replay.counts),
        lambda: _summarise_scenario(store, _find_home(store, analysis, result, replay), replay),
    )


def _keep_latest(replays: Iterable[Campaign]) -> list[Campaign]:
    """Return the newest replay of each mode in each scenario: no trajectory counts twice."""
    newest: dict[bytes, Campaign] = {}
    # Replays come oldest first, so that the newest of a key remains.
    for each in replays:
        identity = (each.spec.scenario_parameters, _list_modes(each.spec))
        newest[msgspec.json.encode(identity, order="deterministic")] = each
    return list(newest.values())


def _list_modes(replay: CampaignSpec) -> list[int]:
    return list(replay.settings.get("modes", ()))


def _find_home(
    store: Store, analysis: Analysis, result: AnalysisResult, replay: Campaign
) -> ReplayWorld:
    # A replay names its modes only if the scenario's parameters vary; otherwise all share a world.
    numbers = _list_modes(replay.spec) or range(1, len(result.modes) + 1)
    modes = tuple(number - 1 for number in numbers)
    # The medoids of the modes of one replay drew the same.
    drawn = result.modes[modes[0]].drawn
    analysed = store.campaigns.get(analysis.campaign).spec
    return ReplayWorld(_put_parameters(analysed, drawn), modes, drawn)


def _summarise_scenario(store: Store, home: ReplayWorld, replay: Campaign) -> ProvenScenario:
    results = store.episodes.finished(replay.id, range(replay.spec.episodes))
    by_index = {result.index: result for result in results}
    kinds = replay.spec.settings.get("what") or (ReplayKind.EIGENFAILURE,)
    # The episodes of a replay have this order, kind by kind, because `read_trajectories` returns
    # the noise in it.
    order = product(map(ReplayKind, kinds), home.modes)
    replays = tuple(
        _read_replay(ReplayedNoise(what=what, mode=mode, campaign=replay.id, index=index), by_index)
        for index, (what, mode) in enumerate(order)
    )
    given = replay.spec.scenario_parameters
    return ProvenScenario(
        scenario_parameters=_list_differing(home.spec, replay.spec),
        # What the world's medoids drew, as far as the replay does not override it.
        drawn={name: value for name, value in home.drawn.items() if given.get(name) == value},
        campaign=replay.id,
        state=replay.state,
        eigenfailures=_count_reproductions(_count_kind(replays, ReplayKind.EIGENFAILURE)),
        medoids=_count_reproductions(_count_kind(replays, ReplayKind.MEDOID)),
        replays=replays,
    )


def _list_differing(world: CampaignSpec, replay: CampaignSpec) -> dict[str, Any]:
    before = world.scenario_parameters
    return {
        name: value
        for name, value in replay.scenario_parameters.items()
        if name not in before or before[name] != value
    }


def _read_replay(planned: ReplayedNoise, results: Mapping[int, EpisodeResult]) -> ReplayedNoise:
    result = results.get(planned.index)
    if result is None or result.measures is None:
        return msgspec.structs.replace(planned, outcome=result.outcome if result else None)
    likelihood = result.noise.log_probability
    return msgspec.structs.replace(
        planned,
        outcome=result.outcome,
        steps=result.steps,
        robustness_m=result.measures.robustness_m,
        log_probability=likelihood,
        log_probability_per_step=likelihood / result.steps if result.steps else None,
        expected_log_probability=expected_log_probability(result.noise),
    )


def _summarise_mode(
    replays: Sequence[ReplayedNoise], mode: int, nearest: NearestFailure | None
) -> ProvenMode:
    ours = [replay for replay in replays if replay.mode == mode]
    eigenfailure, medoid = (_count_reproductions(_count_kind(ours, kind)) for kind in ReplayKind)
    return ProvenMode(mode, eigenfailure, medoid, nearest)


def _count_kind(replays: Iterable[ReplayedNoise], what: ReplayKind) -> Iterator[ReplayedNoise]:
    return (replay for replay in replays if replay.what is what)


def _count_reproductions(replays: Iterable[ReplayedNoise]) -> Reproduction:
    tried = [each for each in replays if each.outcome not in (None, Outcome.ERRORED)]
    if not tried:
        return Reproduction()
    robustness = [each.robustness_m for each in tried if each.robustness_m is not None]
    counted = rate(sum(each.reproduced for each in tried), len(tried))
    # Replays repeat noise that was chosen, and no two of a mode are independent draws.
    return Reproduction(
        msgspec.structs.replace(counted, sampled=False), min(robustness, default=None)
    )


NEARBY = "nearby"
"""Key in the `extra` of a parameter's `Meta`: the distance of its neighbours, in its unit."""

SHARE = 0.25
"""Share of the range of the first bounded parameter, if a scenario names no neighbours."""


class _BoundedParameter(msgspec.Struct, frozen=True):
    """A parameter with two bounds, and the distance to its neighbours."""

    name: str
    low: float
    high: float
    distance: float
    is_named: bool


def list_neighbours(spec: CampaignSpec) -> tuple[dict[str, Any], ...]:
    """Return overrides of a campaign's scenario parameters: none, then one below and one above.

    The scenario may name its neighbours; otherwise its first bounded parameter is moved by a
    quarter of its range. Neighbours stay within the bounds, and a parameter that varies anyway is
    not moved.
    """
    world = world_of(spec.simulator)
    kind = world.parameters_type(spec)
    if kind is None:
        return ({},)
    variation = world.variation(spec)
    parameters = next(iter(variation.corners()))
    moving = {*variation.varied, *variation.searched}
    known = list(_list_bounded(kind))
    # A scenario whose author names no parameter to move has its first one moved.
    moved = [each for each in known if each.is_named] or known[:1]
    fixed = [each for each in moved if each.name not in moving]
    sides = (_move_parameter(each, getattr(parameters, each.name)) for each in fixed)
    return ({}, *(beside for side in sides for beside in side))


def _list_bounded(kind: type[msgspec.Struct]) -> Iterator[_BoundedParameter]:
    for name, hint in get_type_hints(kind, include_extras=True).items():
        for meta in get_args(hint)[1:]:
            if isinstance(meta, msgspec.Meta) and meta.ge is not None and meta.le is not None:
                extra = meta.extra or {}
                step = extra.get(NEARBY, SHARE * (meta.le - meta.ge))
                yield _BoundedParameter(name, meta.ge, meta.le, step, NEARBY in extra)


def _move_parameter(parameter: _BoundedParameter, value: float) -> Iterator[dict[str, Any]]:
    """Return a parameter's neighbours on both sides of a value, within its bounds."""
    for place in (value - parameter.distance, value + parameter.distance):
        within = min(max(place, parameter.low), parameter.high)
        # An integer parameter stays an integer.
        neighbour = type(value)(within)
        if neighbour != value:
            yield {parameter.name: neighbour}


CAME_TO_NOTHING = frozenset({CampaignState.CANCELLED, CampaignState.DEAD})

Parameters = Mapping[str, Any]


def launch_replays(
    store: Store,
    analysis: Analysis,
    variations: Sequence[Parameters] | None,
    made_by: int | None = None,
) -> Proof:
    """Queue a replay in each scenario that has none yet, and return the proof so far.

    Once all replays have ended, a call also queues searches. A search looks for the nearest failing
    point of each mode whose centre did not fail in the scenario of its failures.

    Args:
        store: store of the campaigns.
        analysis: analysis that is done.
        variations: overrides of the scenario parameters of the failures; None: the original
            scenario and its neighbours.
        made_by: id of the key of the request.

    Raises:
        Conflict: the analysis is not done, found no failure mode, covers several worlds, or lacks
            the parameters that the medoids of its modes drew.
        UnknownName: a parameter that the scenario does not have.
        InvalidValue: a parameter outside its bounds, a distribution, or other channels of noise.
        QuotaExceeded: the key's quota of campaigns is used up; those created before stay.
    """
    result = read_result(analysis)
    if not result.modes:
        raise Conflict(
            f"Analysis {analysis.id} found no failure mode, so there is nothing to replay.",
            "Let the campaign run until it has failures, and analyse it again.",
        )
    _refuse_several_worlds(store, analysis)
    _refuse_distributions(variations or ())
    analysed = store.campaigns.get(analysis.campaign).spec
    if validation.list_drawn(analysed) and not all(mode.drawn for mode in result.modes):
        problem = f"Analysis {analysis.id} ran without scenario '{analysed.scenario}' installed."
        raise Conflict(problem, "Install the scenario there, and analyse again.")
    wanted = list_neighbours(analysed) if variations is None else variations
    worlds = _list_worlds(store, analysis, result)
    replays = [
        _check_replay(_make_replay(analysis, analysed, variation, world), analysed, place)
        for place, variation in enumerate(wanted)
        for world in worlds
    ]
    # All replays have been checked before the first one is queued, so that a wrong variation leaves
    # no part of a proof behind.
    for replay in replays:
        _launch_replay(store, analysis.id, replay, made_by)
    found = summarise_proof(store, analysis)
    if not (found.done and found.unplaced):
        return found
    for home in worlds:
        modes = [mode for mode in home.modes if mode in found.unplaced]
        if modes:
            search = validation.check_spec(_make_search(analysis, analysed, home, modes))
            _launch_replay(store, analysis.id, search, made_by)
    return summarise_proof(store, analysis)


def _make_search(
    analysis: Analysis,
    analysed: CampaignSpec,
    home: ReplayWorld,
    modes: Sequence[int],
) -> CampaignSpec:
    name = f"{analysed.name}: nearest failing points of analysis {analysis.id}"
    return msgspec.structs.replace(
        home.spec,
        name=name[-LONGEST_NAME:],
        method=NEAREST,
        settings={"analysis": analysis.id, "modes": [mode + 1 for mode in modes]},
        episodes=MOST_EPISODES * len(modes),
        stop=StopRules(),
        scene_every=1,
    )


def _refuse_distributions(variations: Sequence[Parameters]) -> None:
    for place, variation in enumerate(variations):
        for name, value in variation.items():
            if validation.is_distribution(value):
                problem = "is a distribution: each replay would draw a scenario of its own."
                remedy = "Give it a value, and a variation for each further value."
                raise InvalidValue(f"variations[{place}].{name}", problem, remedy)


def _check_replay(replay: CampaignSpec, analysed: CampaignSpec, place: int) -> ResolvedCampaign:
    """Return the replay in a variation that can be launched.

    Raises:
        UnknownName: a parameter that the scenario does not have.
        InvalidValue: a parameter outside its bounds, or one that makes other channels of noise.
    """
    checked = validation.check_spec(replay)
    if checked.form.channels != list_channels(analysed):
        problem = "are not those of the noise that was analysed."
        raise InvalidValue(f"variations[{place}].channels", problem, "Leave them out.")
    return checked


def _leave_out_equal(world: CampaignSpec, variation: Parameters) -> dict[str, Any]:
    there, absent = _fill_parameters(world), object()
    return {name: value for name, value in variation.items() if there.get(name, absent) != value}


def _make_replay(
    analysis: Analysis,
    analysed: CampaignSpec,
    variation: Parameters,
    home: ReplayWorld,
) -> CampaignSpec:
    spec = _put_parameters(home.spec, _leave_out_equal(home.spec, variation))
    differing = ", ".join(
        f"{name}={value}" for name, value in _list_differing(analysed, spec).items()
    )
    name = f"{analysed.name}: replay of analysis {analysis.id}" + (differing and f", {differing}")
    settings = {"analysis": analysis.id, "what": [kind.value for kind in ReplayKind]}
    # Where nothing is drawn, all modes share one world, and none need be named.
    some = {"modes": [place + 1 for place in home.modes]} if validation.list_drawn(analysed) else {}
    return msgspec.structs.replace(
        spec,
        name=name[-LONGEST_NAME:],
        method=REPLAY,
        settings=settings | some,
        episodes=len(ReplayKind) * len(home.modes),
        stop=StopRules(),
        scene_every=1,
    )


def _launch_replay(
    store: Store, analysis: int, replay: ResolvedCampaign, made_by: int | None
) -> None:
    """Queue a replay, unless there is an equal one that was neither cancelled nor dead.

    Repeated or simultaneous requests get one campaign: a replay gives the same results at any time,
    and its key is derived from its content.
    """
    before = [store.campaigns.get(each) for each in store.analyses.replays(analysis)]
    # A key belongs to its first campaign for ever: counting the lost ones gives the next attempt a
    # new key.
    spec = replay.spec
    lost = sum(each.spec.is_like(spec) and each.state in CAME_TO_NOTHING for each in before)
    key = f"replay {lost} of analysis {analysis}: {spec_hash(spec)}"
    # After a crash between creation and link, the same request finds the campaign by its key and
    # links it.
    launched = store.campaigns.create(replay, key, made_by)
    store.analyses.link_replay(analysis, launched.id)
