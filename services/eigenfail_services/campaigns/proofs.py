"""Proof by replay: an analysis's eigenfailures and medoids, again, here and in other scenarios."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from hashlib import sha256
from itertools import product
from typing import Any

import msgspec

from eigenfail.contracts import Store
from eigenfail.errors import Conflict, InvalidValue
from eigenfail.values import (
    FINAL_STATES,
    Analysis,
    AnalysisResult,
    Campaign,
    CampaignSpec,
    CampaignState,
    EpisodeResult,
    Outcome,
    Proof,
    ProvenMode,
    ProvenScenario,
    ReplayedNoise,
    ReplayKind,
    Reproduction,
    StopRules,
)
from eigenfail_services.campaigns.checks import check_spec
from eigenfail_services.campaigns.nearby import nearby
from eigenfail_services.campaigns.worlds import (
    World,
    defaults,
    in_scenario,
    is_distribution,
    refuse_several,
    varied,
    worlds,
)
from eigenfail_services.statistics.expected_likelihood import expected_log_probability
from eigenfail_services.statistics.intervals import rate

MAX_NAME = 200
CAME_TO_NOTHING = frozenset({CampaignState.CANCELLED, CampaignState.DEAD})

Parameters = Mapping[str, Any]


def prove(store: Store, analysis: Analysis, variations: Sequence[Parameters] | None) -> Proof:
    """Queue a replay in each scenario in which there is none yet, and tell how things stand.

    Args:
        store: where campaigns are.
        analysis: that is done.
        variations: scenario parameters put over those in which the failures happened; None: that
            scenario and its neighbours.

    Raises:
        Conflict: the analysis is not done, found no failure mode, or is of several worlds.
        UnknownName: a parameter that the scenario does not have.
        InvalidValue: a parameter outside its bounds, or a distribution.
    """
    result = findings(analysis)
    if not result.modes:
        raise Conflict(
            f"Analysis {analysis.id} found no failure mode, so there is nothing to replay.",
            "Let the campaign run until it has failures, and analyse it again.",
        )
    refuse_several(store, analysis)
    refuse_distributions(variations or ())
    analysed = store.campaigns.get(analysis.campaign).spec
    wanted = nearby(analysed) if variations is None else variations
    pairs = product(wanted, worlds(store, analysis, result))
    specs = [check_spec(replay_of(analysis, analysed, *pair)) for pair in pairs]
    for spec in specs:
        launch(store, analysis.id, spec)
    return proof(store, analysis)


def findings(analysis: Analysis) -> AnalysisResult:
    """What an analysis found.

    Raises:
        Conflict: it is not done.
    """
    if analysis.result is None:
        raise Conflict(
            f"Analysis {analysis.id} is {analysis.state}. {analysis.problem}".strip(),
            "Wait until it is done, or launch another.",
        )
    return analysis.result


def refuse_distributions(variations: Sequence[Parameters]) -> None:
    """Raises InvalidValue for a variation in which each replay would draw a scenario of its own."""
    for place, variation in enumerate(variations):
        for name, value in variation.items():
            if is_distribution(value):
                problem = "is a distribution: each replay would draw a scenario of its own."
                remedy = "Give it a value, and a variation for each further value."
                raise InvalidValue(f"variations[{place}].{name}", problem, remedy)


def without_idle(world: CampaignSpec, variation: Parameters) -> dict[str, Any]:
    """A variation without what a world has anyway, given or by default."""
    there = defaults(world) | world.scenario_parameters
    absent = object()
    return {name: value for name, value in variation.items() if there.get(name, absent) != value}


def replay_of(
    analysis: Analysis, analysed: CampaignSpec, variation: Parameters, home: World
) -> CampaignSpec:
    """The campaign that replays the modes of a world in a variation of it."""
    spec = in_scenario(home.spec, without_idle(home.spec, variation))
    told = ", ".join(f"{name}={value}" for name, value in differing(analysed, spec).items())
    name = f"{analysed.name}: replay of analysis {analysis.id}" + (told and f", {told}")
    settings = {"analysis": analysis.id, "what": [kind.value for kind in ReplayKind]}
    some = {"modes": [place + 1 for place in home.modes]} if varied(analysed) else {}
    return msgspec.structs.replace(
        spec,
        name=name[-MAX_NAME:],
        method="replay",
        settings=settings | some,
        episodes=len(ReplayKind) * len(home.modes),
        stop=StopRules(),
        scene_every=1,
    )


def launch(store: Store, analysis: int, spec: CampaignSpec) -> None:
    """Queue a replay, unless there is one like it that did not come to nothing.

    Who asks twice, or at the same time as somebody else, gets one campaign: a replay is the same
    whenever it is run, and its key is made of what it is.
    """
    before = [store.campaigns.get(each) for each in store.analyses.replays(analysis)]
    lost = sum(each.spec == spec and each.state in CAME_TO_NOTHING for each in before)
    content = sha256(msgspec.json.encode(spec, order="deterministic")).hexdigest()
    key = f"replay {lost} of analysis {analysis}: {content}"
    store.analyses.link_replay(analysis, store.campaigns.create(spec, key).id)


def proof(store: Store, analysis: Analysis) -> Proof:
    """What the replays of an analysis have shown so far.

    Raises:
        Conflict: the analysis is not done.
    """
    result = findings(analysis)
    homes = worlds(store, analysis, result)
    replays = [store.campaigns.get(each) for each in store.analyses.replays(analysis.id)]
    scenarios = tuple(proven(store, home_of(each, homes), each) for each in latest(replays))
    everything = [replay for scenario in scenarios for replay in scenario.replays]
    same = [replay for scenario in scenarios if scenario.is_same for replay in scenario.replays]
    return Proof(
        analysis=analysis.id,
        done=bool(replays) and all(each.state in FINAL_STATES for each in scenarios),
        reproduced=reproduction(of_kind(same, ReplayKind.EIGENFAILURE)),
        eigenfailures=reproduction(of_kind(everything, ReplayKind.EIGENFAILURE)),
        medoids=reproduction(of_kind(everything, ReplayKind.MEDOID)),
        modes=tuple(proven_mode(everything, mode) for mode in range(len(result.modes))),
        scenarios=scenarios,
    )


def latest(replays: Iterable[Campaign]) -> list[Campaign]:
    """The newest replay of each mode in each scenario, so that no trajectory counts twice in one.

    Replays that drew a scenario of their own each say nothing of one.
    """
    newest = {
        msgspec.json.encode((spec.scenario_parameters, modes_of(spec)), order="deterministic"): each
        for each in replays
        if not varied(spec := each.spec)
    }
    return list(newest.values())


def modes_of(replay: CampaignSpec) -> list[int]:
    """The modes that a replay names, counted from 1; none: all."""
    return list(replay.settings.get("modes", ()))


def home_of(replay: Campaign, homes: Sequence[World]) -> World:
    """The world whose modes are replayed."""
    named = modes_of(replay.spec)
    return next((home for home in homes if home.modes[0] + 1 in named), homes[0])


def proven(store: Store, home: World, replay: Campaign) -> ProvenScenario:
    """The replays of one campaign, as far as they are in."""
    results = store.episodes.finished(replay.id, range(replay.spec.episodes))
    by_index = {result.index: result for result in results}
    kinds = replay.spec.settings.get("what") or (ReplayKind.EIGENFAILURE,)
    order = product(map(ReplayKind, kinds), home.modes)
    replays = tuple(
        replayed(ReplayedNoise(what=what, mode=mode, campaign=replay.id, index=index), by_index)
        for index, (what, mode) in enumerate(order)
    )
    return ProvenScenario(
        scenario_parameters=differing(home.spec, replay.spec),
        campaign=replay.id,
        state=replay.state,
        eigenfailures=reproduction(of_kind(replays, ReplayKind.EIGENFAILURE)),
        medoids=reproduction(of_kind(replays, ReplayKind.MEDOID)),
        replays=replays,
    )


def differing(world: CampaignSpec, replay: CampaignSpec) -> dict[str, Any]:
    """The scenario parameters in which a replay differs from a world."""
    before = world.scenario_parameters
    return {
        name: value
        for name, value in replay.scenario_parameters.items()
        if name not in before or before[name] != value
    }


def replayed(planned: ReplayedNoise, results: Mapping[int, EpisodeResult]) -> ReplayedNoise:
    """A replay with what came of it, if that is in."""
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


def proven_mode(replays: Sequence[ReplayedNoise], mode: int) -> ProvenMode:
    """What a mode's two trajectories did in all scenarios."""
    ours = [replay for replay in replays if replay.mode == mode]
    eigenfailure, medoid = (reproduction(of_kind(ours, kind)) for kind in ReplayKind)
    return ProvenMode(mode, eigenfailure, medoid)


def of_kind(replays: Iterable[ReplayedNoise], what: ReplayKind) -> Iterator[ReplayedNoise]:
    """Those of one kind."""
    return (replay for replay in replays if replay.what is what)


def reproduction(replays: Iterable[ReplayedNoise]) -> Reproduction:
    """How many failed again, of those that were tried."""
    tried = [each for each in replays if each.outcome not in (None, Outcome.FAILED)]
    if not tried:
        return Reproduction()
    robustness = [each.robustness_m for each in tried if each.robustness_m is not None]
    return Reproduction(
        rate(sum(each.reproduced for each in tried), len(tried)),
        min(robustness, default=None),
    )
