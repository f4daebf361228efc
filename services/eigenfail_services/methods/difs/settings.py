"""Settings of `difs`."""

from collections.abc import Sequence
from math import ceil
from typing import Annotated, Literal, Protocol

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from eigenfail.values.arrays import Floats
from eigenfail.values.episode import EpisodeResult, Outcome
from eigenfail.values.learning import Experience
from eigenfail_services.methods import Amount, Id, UpToOne
from eigenfail_services.methods.archive import Arrays, take
from eigenfail_services.methods.difs.modes import Rows


class Examples(msgspec.Struct, frozen=True, eq=False):
    """Training data.

    Attributes:
        z: trajectories, shape (n, horizon, channels). [sigma]
        unseen: whether no noise was injected in a step, shape (n, horizon).
        condition: distance from failure ÷ scale, shape (n,). The distance is the robustness, at
            least 0, less the offset of the trajectory's component.
        held_out: whether a trajectory only validates the network, shape (n,).
        elite: whether a trajectory is one of the elite, shape (n,). The mixture is fitted to the
            elite alone, which has half of the weight in the training of the network.
        modes: largest number of components of the mixture.
    """

    z: Floats
    unseen: NDArray[np.bool_]
    condition: Floats
    held_out: NDArray[np.bool_]
    elite: NDArray[np.bool_]
    modes: int


Share = Annotated[float, Meta(ge=0.0, le=1.0)]


Steps = Annotated[int, Meta(ge=0, le=1_000_000)]


STEPS_PER_JITTER = 30
"""Least number of steps of an episode for each step of shift, so that shifts are small."""


class DifsSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of `difs`.

    `many_rounds` draws little from the prior and then trains after every few episodes. `paper`
    draws 500 from the prior, trains, draws 500 below the threshold, trains, and samples the rest at
    robustness 0.
    """

    schedule: Annotated[
        Literal["many_rounds", "paper"],
        Meta(description="how the episodes are divided, and which train the network"),
    ] = "many_rounds"
    initial_share: Annotated[
        Share | None,
        Meta(description="share of the episodes drawn from the prior; none: the schedule's"),
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
    # The paper keeps the lowest 30 %; the reference code (sisl/DiFS) half.
    quantile: Annotated[
        float,
        Meta(gt=0.0, lt=1.0, description="share of a round that sets the threshold"),
    ] = 0.3
    elite: Annotated[
        Amount, Meta(description="trajectories to which many_rounds fits the mixture")
    ] = 20
    replay: Annotated[
        Share,
        Meta(
            description="share of all trajectories, the least robust, that train the network "
            "besides the elite"
        ),
    ] = 0.25
    likely_share: Annotated[
        UpToOne, Meta(description="share of the elite in the newest failures")
    ] = 0.5
    target_rate: Annotated[
        float,
        Meta(gt=0.0, lt=1.0, description="target failure rate of the guidance"),
    ] = 0.2
    guidance: Annotated[
        float, Meta(ge=-0.9, le=10.0, description="initial weight of the condition")
    ] = 0.15
    final_guidance: Annotated[
        Annotated[float, Meta(ge=-0.9, le=10.0)] | None,
        Meta(description="weight at robustness 0; none: that of the last round"),
    ] = None
    first_steps: Annotated[
        Steps | None,
        Meta(
            description="gradient steps of the network's first training; none: the schedule's; "
            "0, also for `steps`: the mixture alone"
        ),
    ] = None
    steps: Annotated[
        Steps | None,
        Meta(description="gradient steps of each later training; none: the schedule's"),
    ] = None
    jitter: Annotated[
        int,
        Meta(ge=0, le=10_000, description="largest shift in training [steps]; at most 1 in 30"),
    ] = 3
    width: Annotated[
        int, Meta(ge=1, le=4096, description="channels of the denoiser's hidden layers")
    ] = 24
    learning_rate: Annotated[UpToOne, Meta(description="learning rate of AdamW")] = 2e-3
    weight_decay: Annotated[float, Meta(ge=0.0, le=1.0, description="weight decay of AdamW")] = 1e-5
    batch_size: Annotated[Amount, Meta(description="trajectories in a gradient step")] = 32
    ema: Annotated[float, Meta(ge=0.0, lt=1.0, description="decay of the averaged weights")] = 0.995
    # The reference takes 1000 steps. Twenty cost a fiftieth, and stay exact for a normal.
    sampling_steps: Annotated[
        int, Meta(ge=1, le=10_000, description="steps in which a trajectory is sampled")
    ] = 20
    memory: Annotated[int, Meta(ge=10, le=1_000_000, description="trajectories in memory")] = 10_000
    device: Annotated[
        Literal["auto", "cpu", "cuda"],
        Meta(description="device of the model; auto: cuda if available"),
    ] = "auto"
    data_from: Annotated[
        tuple[Id, ...],
        Meta(description="earlier campaigns whose episodes are initial training data"),
    ] = ()

    def choose_jitter(self, horizon: int) -> int:
        """Return the largest shift in training, so small that an episode stays what it is."""
        return min(self.jitter, horizon // STEPS_PER_JITTER)


PATIENCE = 2
"""A mode without failures is dropped after this number of elites of failures elsewhere."""


class TrialMemory:
    """Noise trajectories with their robustness; a full memory drops the safest ones.

    Args:
        horizon: number of steps of a full episode.
        channels: number of channels of the noise.
        memory: number of trajectories.
    """

    def __init__(self, horizon: int, channels: int, memory: int) -> None:
        self._memory = memory
        self.z = np.zeros((0, horizon, channels), np.float32)
        self.steps = np.zeros(0, np.int64)
        self.robustness = np.zeros(0, np.float32)

    def __len__(self) -> int:
        return len(self.robustness)

    def add(self, results: Sequence[EpisodeResult]) -> None:
        """Add completed episodes."""
        for result in results:
            # Without measures there is no robustness to sort by.
            if result.outcome is not Outcome.ERRORED and result.measures is not None:
                steps = len(result.noise.z)
                padded = np.zeros((1, *self.z.shape[1:]), np.float32)
                padded[0, :steps] = result.noise.z
                self._append(padded, np.array([steps]), np.array([result.measures.robustness_m]))
        self._forget()

    def add_experience(self, experience: Experience) -> None:
        """Add episodes of earlier campaigns."""
        self._append(experience.z, experience.steps, experience.robustness_m)
        self._forget()

    def arrays(self) -> Arrays:
        """Return the trajectories, their lengths and their robustness."""
        return {"z": self.z, "steps": self.steps, "robustness": self.robustness}

    def load(self, arrays: Arrays) -> None:
        """Restore the trajectories.

        Raises:
            ValueError: an array is missing or has another shape.
        """
        robustness = arrays["robustness"]
        z = take(arrays, "z", (len(robustness), *self.z.shape[1:]))
        self.steps = take(arrays, "steps", (len(robustness),))
        self.z, self.robustness = z, robustness

    def quantile(self, share: float) -> float:
        """Return a quantile of the robustness; inf without trajectories. [m]"""
        return float(np.quantile(self.robustness, share)) if len(self) else float("inf")

    def select_elite(self, count: int, likely_share: float, kinds: Rows) -> Rows:
        """Return the best trajectories, equally many of each kind.

        A few dozen failures do not show which kind has more of p(z | failure), and a kind that has
        more by chance would soon displace the others.

        Args:
            count: number of trajectories.
            likely_share: share of a kind's newest failures that are selected by likelihood.
            kinds: component of each trajectory, shape (n,).
        """
        kept = self._list_kinds(count, kinds)
        # Rounded up, so that every kind has a part.
        each = ceil(count / len(kept))
        return np.concatenate([self._best(rows, each, likely_share) for rows in kept])

    def select_replay(self, share: float) -> Rows:
        """Return the least robust share of the trajectories.

        The network learns from more than the elite how noise depends on robustness.
        """
        order = np.argsort(self.robustness, kind="stable")
        return order[: ceil(share * len(self))]

    def find_offsets(self, kinds: Rows) -> Floats:
        """Return the distance from the best of all to the best of each's kind, shape (n,). [m]

        All failures have the distance 0: the condition says that an episode fails, not how badly.
        With this subtracted, the lowest robustness of all denotes the best of each kind. Otherwise
        samples would be requested that a kind has never reached, and the model would leave it.
        """
        distances = np.maximum(self.robustness, 0.0)
        best = np.full(kinds.max(initial=0) + 1, np.inf, np.float32)
        np.minimum.at(best, kinds, distances)
        late: Floats = best[kinds] - distances.min()
        return late

    def has_elites(self, count: int, kinds: Rows) -> bool:
        """Whether each kind has enough failures for its part of an elite of `count`."""
        kept = self._list_kinds(count, kinds)
        return all(len(self._failures(rows)) >= count / len(kept) for rows in kept)

    def find_unseen(self) -> NDArray[np.bool_]:
        """Return which steps lie behind an episode's end, shape (n, horizon).

        No noise was injected there, and none would have mattered: given a failure, it has the
        prior's distribution, and training fills it with new draws. Zeros would make the model too
        narrow there.
        """
        return np.arange(self.z.shape[1]) >= self.steps[:, None]

    def _list_kinds(self, count: int, kinds: Rows) -> list[Rows]:
        """Return the trajectories of each kind; with enough failures, only of kinds that failed."""
        each = [np.flatnonzero(kinds == kind) for kind in np.unique(kinds)]
        # So few failures do not show that a kind has none.
        if np.count_nonzero(self.robustness <= 0.0) < PATIENCE * count:
            return each
        return [rows for rows in each if len(self._failures(rows))]

    def _failures(self, rows: Rows) -> Rows:
        return rows[self.robustness[rows] <= 0.0]

    def _best(self, rows: Rows, count: int, likely_share: float) -> Rows:
        """Return the least robust ones; of more than `count` failures, the likelier of the newest.

        Likelihood is measured along their common mean m, by -z·m: that is log p - log q for a
        proposal q = N(m, 1), up to a constant. By log p alone, noise in directions that do not
        matter would decide. The newest come from proposals with less of such noise.
        """
        failures = self._failures(rows)
        if len(failures) <= count:
            return rows[np.argsort(self.robustness[rows], kind="stable")[:count]]
        newest = failures[-ceil(count / likely_share) :]
        z = self.z[newest].reshape(len(newest), -1)
        return newest[np.argsort(z @ z.mean(axis=0), kind="stable")[:count]]

    def _append(self, z: Floats, steps: NDArray[np.number], robustness: Floats) -> None:
        self.z = np.concatenate([self.z, z.astype(np.float32)])
        self.steps = np.concatenate([self.steps, steps.astype(np.int64)])
        self.robustness = np.concatenate([self.robustness, robustness.astype(np.float32)])

    def _forget(self) -> None:
        if len(self) > self._memory:
            # `lexsort` sorts by its last key first: by robustness, and among equals the newest.
            newest_first = -np.arange(len(self))
            kept = np.sort(np.lexsort((newest_first, self.robustness))[: self._memory])
            self.z, self.steps = self.z[kept], self.steps[kept]
            self.robustness = self.robustness[kept]


PAPER_SIZE = 500
"""Episodes from the prior, and again below the threshold."""

PAPER_STEPS = 400
"""Gradient steps of each training: with two trainings in all, each must go further."""


FIRST_SHARE = 0.08


DRAWS_PER_ELITE = 4
"""Least number of draws from the prior for each trajectory that is trained on."""


ROUND_SHARE, SMALLEST_ROUND = 0.04, 10


class DifsPlan(msgspec.Struct, frozen=True):
    """Division of the episodes of a campaign.

    Attributes:
        initial: number of episodes from the prior.
        round_size: number of episodes between two trainings after that.
        final: number of the first episode of the last part, at robustness 0.
        first_steps: number of gradient steps of the network's first training.
        steps: number of gradient steps of each later training.
        waits: whether the network waits until the elites of all modes are failures.
    """

    initial: int
    round_size: int
    final: int
    first_steps: int
    steps: int
    waits: bool


class Schedule(Protocol):
    """A named division of episodes, and choice of training data."""

    def plan(self, episodes: int, settings: DifsSettings) -> DifsPlan:
        """Return the division of a budget, where the settings do not define it."""

    def select(
        self, trials: TrialMemory, kinds: Rows, threshold_m: float, settings: DifsSettings
    ) -> Rows:
        """Return the trajectories of the next mixture; `kinds` are their components."""


class ManyRounds:
    """Few draws from the prior, many small rounds, and training to the end."""

    def plan(self, episodes: int, settings: DifsSettings) -> DifsPlan:
        """Return 8 % from the prior, at least four for each of the elite; rounds of 4 %."""
        # With fewer, the elite would hardly be better than the draws that it comes from.
        fewest = min(DRAWS_PER_ELITE * settings.elite, episodes // 2)
        round_size = max(SMALLEST_ROUND, round(ROUND_SHARE * episodes))
        initial = max(round(FIRST_SHARE * episodes), fewest)
        return DifsPlan(initial, round_size, episodes, first_steps=300, steps=100, waits=True)

    def select(
        self, trials: TrialMemory, kinds: Rows, _threshold_m: float, settings: DifsSettings
    ) -> Rows:
        """Return the elite of each kind."""
        return trials.select_elite(settings.elite, settings.likely_share, kinds)


class PaperSchedule:
    """500 from the prior, 500 below the threshold, and the rest at robustness 0."""

    def plan(self, episodes: int, _settings: DifsSettings) -> DifsPlan:
        """Return the division of the paper; two halves for a budget below 1000."""
        half = min(PAPER_SIZE, (episodes + 1) // 2)
        final = min(2 * PAPER_SIZE, episodes)
        return DifsPlan(half, PAPER_SIZE, final, PAPER_STEPS, PAPER_STEPS, waits=False)

    def select(
        self, trials: TrialMemory, _kinds: Rows, threshold_m: float, _settings: DifsSettings
    ) -> Rows:
        """Return all trajectories at or below the threshold."""
        return np.flatnonzero(trials.robustness <= np.float32(threshold_m))


SCHEDULES: dict[str, Schedule] = {"many_rounds": ManyRounds(), "paper": PaperSchedule()}


def make_plan(episodes: int, settings: DifsSettings) -> DifsPlan:
    """Return the plan of the schedule, with the settings that override it."""
    plan = SCHEDULES[settings.schedule].plan(episodes, settings)
    changes: dict[str, int] = {}
    if settings.initial_share is not None:
        changes["initial"] = max(1, round(settings.initial_share * episodes))
    if settings.final_share is not None:
        changes["final"] = episodes - round(settings.final_share * episodes)
    given = {name: getattr(settings, name) for name in ("round_size", "first_steps", "steps")}
    changes |= {name: value for name, value in given.items() if value is not None}
    return msgspec.structs.replace(plan, **changes)
