"""Proof by replay, launched: eigenfailures and medoids again, here and in other scenarios."""

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import msgspec

from eigenfail.contracts import Store
from eigenfail.errors import Conflict, InvalidValue
from eigenfail.values import (
    Analysis,
    CampaignSpec,
    CampaignState,
    Proof,
    ReplayKind,
    StopRules,
)
from eigenfail.values.campaign import LONGEST_NAME
from eigenfail_services.campaigns.checks import check_spec
from eigenfail_services.campaigns.nearby import nearby
from eigenfail_services.campaigns.proofs import differing, findings, proof
from eigenfail_services.campaigns.worlds import (
    World,
    defaults,
    in_scenario,
    is_distribution,
    refuse_several,
    varied,
    worlds,
)
from eigenfail_services.store.codec import spec_hash

CAME_TO_NOTHING = frozenset({CampaignState.CANCELLED, CampaignState.DEAD})

Parameters = Mapping[str, Any]


def prove(
    store: Store,
    analysis: Analysis,
    variations: Sequence[Parameters] | None,
    made_by: int | None = None,
) -> Proof:
    """Queue a replay in each scenario in which there is none yet, and tell how things stand.

    Args:
        store: where campaigns are.
        analysis: that is done.
        variations: scenario parameters put over those in which the failures happened; None: that
            scenario and its neighbours.
        made_by: id of the key of whoever asks.

    Raises:
        Conflict: the analysis is not done, found no failure mode, or is of several worlds.
        UnknownName: a parameter that the scenario does not have.
        InvalidValue: a parameter outside its bounds, or a distribution.
        QuotaExceeded: the key does not allow so many more campaigns; those before stay.
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
        launch(store, analysis.id, spec, made_by)
    return proof(store, analysis)


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
        name=name[-LONGEST_NAME:],
        method="replay",
        settings=settings | some,
        episodes=len(ReplayKind) * len(home.modes),
        stop=StopRules(),
        scene_every=1,
    )


def launch(store: Store, analysis: int, spec: CampaignSpec, made_by: int | None) -> None:
    """Queue a replay, unless there is one like it that did not come to nothing.

    Who asks twice, or at the same time as somebody else, gets one campaign: a replay is the same
    whenever it is run, and its key is made of what it is.
    """
    before = [store.campaigns.get(each) for each in store.analyses.replays(analysis)]
    lost = sum(each.spec.is_like(spec) and each.state in CAME_TO_NOTHING for each in before)
    key = f"replay {lost} of analysis {analysis}: {spec_hash(spec)}"
    store.analyses.link_replay(analysis, store.campaigns.create(spec, key, made_by).id)
