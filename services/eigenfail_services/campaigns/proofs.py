"""Proof by replay: what came of eigenfailures and medoids that were injected again."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import product
from typing import Any

import msgspec

from eigenfail.contracts import Store
from eigenfail.errors import Conflict
from eigenfail.values import (
    FINAL_STATES,
    Analysis,
    AnalysisResult,
    Campaign,
    CampaignSpec,
    EpisodeResult,
    Outcome,
    Proof,
    ProvenMode,
    ProvenScenario,
    ReplayedNoise,
    ReplayKind,
    Reproduction,
)
from eigenfail_services.campaigns.remembered import Remembered
from eigenfail_services.campaigns.worlds import (
    World,
    varied,
    worlds,
)
from eigenfail_services.statistics.expected_likelihood import expected_log_probability
from eigenfail_services.statistics.intervals import rate

MOST_SCENARIOS = 1_000
MOST_ANALYSES = 100

KNOWN_SCENARIOS: Remembered[ProvenScenario] = Remembered(MOST_SCENARIOS)
KNOWN_WORLDS: Remembered[list[World]] = Remembered(MOST_ANALYSES)


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


def proof(store: Store, analysis: Analysis) -> Proof:
    """What the replays of an analysis have shown so far.

    Raises:
        Conflict: the analysis is not done.
    """
    result = findings(analysis)
    # A result that is there changes no more, and its campaigns' specs never do.
    homes = KNOWN_WORLDS.get(store, analysis.id, None, lambda: worlds(store, analysis, result))
    replays = [store.campaigns.get(each) for each in store.analyses.replays(analysis.id)]
    scenarios = tuple(known(store, analysis, homes, each) for each in latest(replays))
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


def known(
    store: Store, analysis: Analysis, homes: Sequence[World], replay: Campaign
) -> ProvenScenario:
    """The replays of one campaign, read anew only where more of them are in.

    Results stay as they are for good, and the counts change with each that comes in.
    """
    return KNOWN_SCENARIOS.get(
        store,
        (analysis.id, replay.id),
        (replay.state, replay.counts),
        lambda: proven(store, home_of(replay, homes), replay),
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
        drawn=still_drawn(home, replay.spec),
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


def still_drawn(home: World, replay: CampaignSpec) -> dict[str, Any]:
    """What the medoids of a world drew of its scenario, but for what a replay puts over it."""
    given = replay.scenario_parameters
    return {name: value for name, value in home.drawn.items() if given.get(name) == value}


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
