"""What the paper ran, as campaigns of one suite."""

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any

import msgspec

from eigenfail.errors import UnknownName
from eigenfail.suites import Member, Suite
from eigenfail.values import CampaignSpec

FRESH = 1000
"""Added to a seed: what was learnt is evaluated on draws that training never saw."""

USUAL_DISTANCE_M = 58.0
MOVED_M = MappingProxyType({"plus5": 5.0, "minus5": -5.0})

SWEPT: Mapping[str, Any] = MappingProxyType(
    {
        "alpha": 10_000,
        "c_dist": 1000,
        "tau": 0.005,
        "learning_rate": 3e-4,
        "batch_size": 64,
        "buffer_size": 100_000,
    }
)
"""The defaults of the paper's sweep; all else as it is here by default."""

SWEEP: Mapping[str, tuple[Any, ...]] = MappingProxyType(
    {
        "alpha": (500, 1000, 5000),
        "c_dist": (100, 5000),
        "tau": (0.001, 0.01),
        "learning_rate": (1e-3, 1e-4, 5e-5),
        "batch_size": (16, 256),
        "buffer_size": (10_000, 1_000_000),
    }
)
"""Each varied alone; where a row of the paper's table is the default it is run once."""

CHOSEN: Mapping[str, Any] = MappingProxyType(
    {
        "alpha": 5000,
        "c_dist": 1000,
        "tau": 0.001,
        "learning_rate": 3e-4,
        "batch_size": 16,
        "buffer_size": 10_000,
    }
)
"""What the paper chose for its main runs."""


class Scale(msgspec.Struct, frozen=True):
    """Episodes of each kind of campaign, and the seed unless another is given."""

    seed: int
    monte_carlo: int
    sweep: int
    training: int
    evaluation: int
    moved: int


SCALES: Mapping[str, Scale] = MappingProxyType(
    {
        "full": Scale(
            seed=20261122, monte_carlo=2000, sweep=300, training=1000, evaluation=300, moved=100
        ),
        "small": Scale(seed=1, monte_carlo=300, sweep=120, training=300, evaluation=100, moved=50),
    }
)
"""`full` has the paper's numbers of episodes."""

LEARNERS: Mapping[str, tuple[str, Mapping[str, Any]]] = MappingProxyType(
    {
        "ast": ("ast", {}),
        "ast_paper": ("ast", CHOSEN),
        "difs": ("difs", {}),
        "difs_paper": ("difs", {"schedule": "paper"}),
    }
)
"""Method and settings: as they are here by default, and as they are in the paper."""


def programme(scale: str, seed: int | None = None) -> Suite:
    """All campaigns of the paper; a member that evaluates names the one that it evaluates.

    Args:
        scale: a name in `SCALES`.
        seed: of every campaign; evaluations draw from one that is 1000 higher. None: the scale's.

    Raises:
        UnknownName: no such scale.
    """
    if scale not in SCALES:
        raise UnknownName("scale", scale, SCALES)
    episodes = SCALES[scale]
    name = f"paper {scale}"
    members = (*planners(episodes), *sweep(episodes), *learners(episodes), *evaluations(episodes))
    chosen = episodes.seed if seed is None else seed
    return Suite(name, tuple(member(name, chosen, *one) for one in members))


Wanted = tuple[str, dict[str, Any]]


def planners(scale: Scale) -> Iterator[Wanted]:
    """Both planners under Monte Carlo."""
    for planner in ("rulebook", "idm"):
        yield (
            f"monte_carlo {planner}",
            {"method": "monte_carlo", "planner": planner, "episodes": scale.monte_carlo},
        )


def sweep(scale: Scale) -> Iterator[Wanted]:
    """AST around the defaults of the paper's sweep."""
    yield "sweep base", trained("ast", SWEPT, scale.sweep)
    for name, values in SWEEP.items():
        for value in values:
            settings = {**SWEPT, name: value}
            yield f"sweep {name}={value}", trained("ast", settings, scale.sweep)


def learners(scale: Scale) -> Iterator[Wanted]:
    """The searches of the main experiments."""
    for name, (method, settings) in LEARNERS.items():
        yield name, trained(method, settings, scale.training)


def evaluations(scale: Scale) -> Iterator[Wanted]:
    """What they have learnt, here and where the other car cuts in 5 m further or nearer."""
    for name in LEARNERS:
        yield f"{name} evaluation", evaluated(name, scale.evaluation)
    for name in ("ast", "ast_paper"):
        for place, by_m in MOVED_M.items():
            moved = {"distance_m": USUAL_DISTANCE_M + by_m}
            yield f"{name} {place}", evaluated(name, scale.moved, moved)


def trained(method: str, settings: Mapping[str, Any], episodes: int) -> dict[str, Any]:
    """A campaign that learns."""
    return {"method": method, "settings": dict(settings), "episodes": episodes}


def evaluated(
    name: str, episodes: int, parameters: Mapping[str, float] | None = None
) -> dict[str, Any]:
    """A campaign under what an earlier one has learnt."""
    return {
        "method": "evaluate",
        "settings": {"campaign": name},
        "episodes": episodes,
        "scenario_parameters": {"distance_m": USUAL_DISTANCE_M, **(parameters or {})},
    }


def member(suite: str, seed: int, name: str, fields: Mapping[str, Any]) -> Member:
    """The campaign of a member."""
    fresh = seed + FRESH if fields["method"] == "evaluate" else seed
    usual = {"scenario_parameters": {"distance_m": USUAL_DISTANCE_M}, "seed": fresh}
    return Member(name, CampaignSpec(name=f"{suite}: {name}", **{**usual, **fields}))
