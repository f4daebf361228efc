"""Settings of `difs`, how its schedules divide a campaign, and what its network is trained on."""

from collections.abc import Callable
from math import ceil
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from eigenfail.values.arrays import Floats
from eigenfail_services.methods import Amount, Id, UpToOne

Share = Annotated[float, Meta(ge=0.0, le=1.0)]
PartShare = Annotated[float, Meta(ge=0.0, lt=1.0)]
Steps = Annotated[int, Meta(ge=1, le=1_000_000)]

STEPS_PER_JITTER = 20
"""Least number of steps of an episode for each step of shift, so that shifts are small."""


class DifsSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of `difs`.

    `many_rounds` trains after each round, by default fifteen or fewer. `paper` draws 500 from p(x),
    trains, draws 500 below the threshold, trains, and samples the rest at robustness 0.
    """

    schedule: Annotated[
        Literal["many_rounds", "paper"],
        Meta(description="how the episodes are divided, and what the network is trained on"),
    ] = "many_rounds"
    initial_share: Annotated[
        UpToOne | None,
        Meta(description="share of the episodes drawn from p(x) at first; none: the schedule's"),
    ] = None
    round_size: Annotated[
        Amount | None,
        Meta(description="episodes between two trainings; none: the schedule's"),
    ] = None
    final_share: Annotated[
        Share | None,
        Meta(
            description="share sampled at robustness 0 at the end, without training; "
            "none: the schedule's"
        ),
    ] = None
    prior_share: Annotated[
        PartShare | None,
        Meta(description="share of later rounds that is drawn from p(x); none: the schedule's"),
    ] = None
    moved_share: Annotated[
        PartShare | None,
        Meta(
            description="share of the network's samples that are shifted in time and mirrored; "
            "none: the schedule's"
        ),
    ] = None
    target_rate: Annotated[
        UpToOne | None,
        Meta(
            description="share of the network's samples that are meant to fail; smaller: "
            "likelier failures, fewer of them; none: the schedule's"
        ),
    ] = None
    # The paper keeps the lowest 30 %; the reference code (sisl/DiFS) half.
    quantile: Annotated[
        float,
        Meta(gt=0.0, lt=1.0, description="share of a round that sets the threshold"),
    ] = 0.3
    first_steps: Annotated[
        Steps | None,
        Meta(description="gradient steps of the first training; none: the schedule's"),
    ] = None
    steps: Annotated[
        Steps | None,
        Meta(description="gradient steps of each later training; none: the schedule's"),
    ] = None
    batch_size: Annotated[
        int, Meta(ge=2, le=100_000, description="trajectories in a gradient step")
    ] = 64
    jitter: Annotated[
        int,
        Meta(
            ge=0,
            le=10_000,
            description="largest shift in training [steps]; at most a twentieth of them",
        ),
    ] = 3
    width: Annotated[
        int, Meta(ge=1, le=4096, description="channels of the network's hidden layers")
    ] = 48
    learning_rate: Annotated[UpToOne, Meta(description="learning rate of AdamW")] = 2e-3
    ema: Annotated[float, Meta(ge=0.0, lt=1.0, description="decay of the averaged weights")] = 0.995
    # The reference takes 1000 steps. Thirty cost a thirtieth, and stay exact for a normal.
    sampling_steps: Annotated[
        int, Meta(ge=1, le=10_000, description="steps in which a trajectory is sampled")
    ] = 30
    memory: Annotated[
        int,
        Meta(
            ge=10,
            le=1_000_000,
            description="trajectories in memory, and as many moved ones; the safest are dropped",
        ),
    ] = 20_000
    device: Annotated[
        Literal["auto", "cpu", "cuda"],
        Meta(description="device of the network; auto: cuda if available"),
    ] = "auto"
    data_from: Annotated[
        tuple[Id, ...],
        Meta(description="earlier campaigns whose episodes are initial training data"),
    ] = ()

    def choose_jitter(self, horizon: int) -> int:
        """Return the largest shift in training, so small that an episode stays what it is."""
        return min(self.jitter, horizon // STEPS_PER_JITTER)


class DifsPlan(msgspec.Struct, frozen=True):
    """Division of the episodes of a campaign, and choice of the training data.

    Attributes:
        initial: number of episodes from the prior.
        round_size: number of episodes between two trainings after that.
        final: number of the first episode of the last part, at robustness 0.
        first_steps: number of gradient steps of the first training.
        steps: number of gradient steps of each later training.
        prior_share: share of a later round that is drawn from the prior.
        moved_share: share of the network's samples that are shifted in time and mirrored.
        elite_share: share of the elite in a batch.
        target_rate: share of the network's samples that should fail, by the excess that they are
            asked for; None: the network is not told the excess.
        preference: how strongly training prefers likely noise: in the elite, the likeliest
            trajectory weighs exp(preference) times as much as the least likely one.
    """

    initial: int
    round_size: int
    final: int
    first_steps: int
    steps: int
    prior_share: float
    moved_share: float
    elite_share: float
    target_rate: float | None
    preference: float


ROUNDS = 15

SMALLEST_ROUND, FEWEST_ROUNDS = 40, 4
"""A smaller budget has fewer rounds: with smaller ones, a training would learn too little new."""

PAPER_SIZE = 500
"""Episodes from the prior, and again below the threshold."""

PAPER_STEPS = 1000
"""Gradient steps of each training: with two trainings in all, each must go further."""


def plan_many_rounds(episodes: int, settings: DifsSettings) -> DifsPlan:
    """Return rounds of one size, the first from the prior, with training to the end."""
    least = min(SMALLEST_ROUND, ceil(episodes / FEWEST_ROUNDS))
    size = settings.round_size or max(ceil(episodes / ROUNDS), least)
    return DifsPlan(
        initial=min(size, episodes),
        round_size=size,
        final=episodes,
        first_steps=400,
        steps=300,
        prior_share=0.2,
        moved_share=0.3,
        elite_share=0.5,
        target_rate=0.5,
        preference=4.0,
    )


def plan_paper(episodes: int, _settings: DifsSettings) -> DifsPlan:
    """Return the division of the paper; two halves for a budget below 1000."""
    return DifsPlan(
        initial=min(PAPER_SIZE, (episodes + 1) // 2),
        round_size=PAPER_SIZE,
        final=min(2 * PAPER_SIZE, episodes),
        first_steps=PAPER_STEPS,
        steps=PAPER_STEPS,
        prior_share=0.0,
        moved_share=0.0,
        elite_share=1.0,
        target_rate=None,
        preference=0.0,
    )


SCHEDULES: dict[str, Callable[[int, DifsSettings], DifsPlan]] = {
    "many_rounds": plan_many_rounds,
    "paper": plan_paper,
}

OVERRIDES = ("round_size", "first_steps", "steps", "prior_share", "moved_share", "target_rate")
"""Settings that replace what the schedule says under the same name."""


def make_plan(episodes: int, settings: DifsSettings) -> DifsPlan:
    """Return the plan of the schedule, with the settings that override it.

    The last part begins after the episodes from the prior, whatever its share.
    """
    plan = SCHEDULES[settings.schedule](episodes, settings)
    given = {name: getattr(settings, name) for name in OVERRIDES}
    changes = {name: value for name, value in given.items() if value is not None}
    if settings.initial_share is not None:
        changes["initial"] = max(1, round(settings.initial_share * episodes))
    if settings.final_share is not None:
        changes["final"] = episodes - round(settings.final_share * episodes)
    plan = msgspec.structs.replace(plan, **changes)
    return msgspec.structs.replace(plan, final=max(plan.initial, plan.final))


LARGEST_CONDITION = 10.0
"""Largest condition: robustness far from failures is all alike, and must not dominate."""


class LabelledNoise(msgspec.Struct, frozen=True, eq=False):
    """Training data.

    Attributes:
        z: trajectories, shape (n, horizon, channels). [sigma]
        unseen: whether no noise was injected in a step, shape (n, horizon).
        condition: robustness ÷ scale, within 0 and `LARGEST_CONDITION`, shape (n,).
        excess: excess of the squared noise over p(x), shape (n,); see `compute_excess`.
        weights: chance of each trajectory in the elite's part of a batch, shape (n,). It is 0
            outside the elite.
    """

    z: Floats
    unseen: NDArray[np.bool_]
    condition: Floats
    excess: Floats
    weights: NDArray[np.float64]
