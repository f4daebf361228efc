"""The paper's experiments, as campaigns of one suite."""

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any

import msgspec

from eigenfail.errors import UnknownName
from eigenfail.suites import Suite, SuiteMember
from eigenfail.values import CampaignSpec

FRESH = 1000
"""Added to a seed: what was learnt is evaluated on draws that training never saw."""

GRADIENT_STEPS = 4
"""Of AST with the paper's settings, for each decision; the paper gives no number. Ten decisions an
episode with one step each learn too little at its learning rates."""

USUAL_DISTANCE_M = 58.0
STEP_S = 0.1
"""Of `cut_in`."""
MOVED_M = MappingProxyType({"plus5": 5.0, "minus5": -5.0})

SWEPT: Mapping[str, Any] = MappingProxyType(
    {
        "alpha": 10_000,
        "c_dist": 1000,
        "tau": 0.005,
        "learning_rate": 3e-4,
        "batch_size": 64,
        "buffer_size": 100_000,
        "gradient_steps": GRADIENT_STEPS,
    }
)
"""Settings of the paper's sweep; all others have the defaults of this release."""

SWEEP: Mapping[str, tuple[Any, ...]] = MappingProxyType(
    {
        "alpha": (500, 1000, 5000),
        "c_dist": (100, 5000),
        "learning_rate": (1e-3, 1e-4, 5e-5),
        "batch_size": (16, 256),
    }
)
"""Each varied alone; a value of the paper's table that is the default is run once.

The paper also varies tau and the size of the buffer. Neither has an effect here: an episode has at
most ten decisions, as many as `n_step` sums, so that the target critics are never used, and all
decisions of 300 episodes fit into the smallest buffer.
"""

CHOSEN: Mapping[str, Any] = MappingProxyType(
    {
        "alpha": 5000,
        "c_dist": 1000,
        "tau": 0.001,
        "learning_rate": 3e-4,
        "batch_size": 16,
        "buffer_size": 10_000,
        "gradient_steps": GRADIENT_STEPS,
    }
)
"""What the paper chose for its main runs."""


class ProgrammeScale(msgspec.Struct, frozen=True):
    """Number of episodes of each kind of campaign, and the default seed."""

    seed: int
    monte_carlo: int
    sweep: int
    training: int
    evaluation: int
    moved: int


SCALES: Mapping[str, ProgrammeScale] = MappingProxyType(
    {
        "full": ProgrammeScale(
            seed=20261122, monte_carlo=2000, sweep=300, training=1000, evaluation=300, moved=100
        ),
        "small": ProgrammeScale(
            seed=1, monte_carlo=300, sweep=120, training=300, evaluation=100, moved=50
        ),
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


def build_suite(scale: str, seed: int | None = None) -> Suite:
    """Build the suite of the paper's campaigns; evaluations name the member that they evaluate.

    Args:
        scale: a name in `SCALES`.
        seed: seed of every campaign; evaluations draw from one that is 1000 higher. None: the
            scale's.

    Raises:
        UnknownName: no such scale.
    """
    if scale not in SCALES:
        raise UnknownName("scale", scale, SCALES)
    episodes = SCALES[scale]
    name = f"paper {scale}"
    members = (
        *_plan_planners(episodes),
        *_plan_sweep(episodes),
        *_plan_learners(episodes),
        *_plan_evaluations(episodes),
    )
    chosen = episodes.seed if seed is None else seed
    return Suite(name, tuple(_make_member(name, chosen, *one) for one in members))


MemberFields = tuple[str, dict[str, Any]]


def _plan_planners(scale: ProgrammeScale) -> Iterator[MemberFields]:
    for planner in ("rulebook", "idm"):
        yield (
            f"monte_carlo {planner}",
            {"method": "monte_carlo", "planner": planner, "episodes": scale.monte_carlo},
        )


def _plan_sweep(scale: ProgrammeScale) -> Iterator[MemberFields]:
    yield "sweep base", _plan_training("ast", SWEPT, scale.sweep)
    for name, values in SWEEP.items():
        for value in values:
            settings = {**SWEPT, name: value}
            yield f"sweep {name}={value}", _plan_training("ast", settings, scale.sweep)


def _plan_learners(scale: ProgrammeScale) -> Iterator[MemberFields]:
    for name, (method, settings) in LEARNERS.items():
        yield name, _plan_training(method, settings, scale.training)


def _plan_evaluations(scale: ProgrammeScale) -> Iterator[MemberFields]:
    """Plan the evaluation of each learner, and of AST where the car cuts in 5 m off."""
    for name in LEARNERS:
        yield f"{name} evaluation", _plan_evaluation(name, scale.evaluation)
    for name in ("ast", "ast_paper"):
        for place, by_m in MOVED_M.items():
            moved = {"distance_m": USUAL_DISTANCE_M + by_m}
            yield f"{name} {place}", _plan_evaluation(name, scale.moved, moved)


def _plan_training(method: str, settings: Mapping[str, Any], episodes: int) -> dict[str, Any]:
    return {"method": method, "settings": dict(settings), "episodes": episodes}


def _plan_evaluation(
    name: str, episodes: int, parameters: Mapping[str, float] | None = None
) -> dict[str, Any]:
    return {
        "method": "evaluate",
        "settings": {"campaign": name},
        "episodes": episodes,
        "scenario_parameters": {"distance_m": USUAL_DISTANCE_M, **(parameters or {})},
    }


def _make_member(suite: str, seed: int, name: str, fields: Mapping[str, Any]) -> SuiteMember:
    fresh = seed + FRESH if fields["method"] == "evaluate" else seed
    usual = {"scenario_parameters": {"distance_m": USUAL_DISTANCE_M}, "seed": fresh}
    return SuiteMember(name, CampaignSpec(name=f"{suite}: {name}", **{**usual, **fields}))
