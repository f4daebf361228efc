"""Tasks and results of episodes."""

import hashlib
import struct
from enum import StrEnum
from typing import Annotated, Any

import msgspec
import numpy as np

from eigenfail.errors import clean_text
from eigenfail.values.arrays import Floats
from eigenfail.values.disturbance import DisturbanceModel, NoiseTrajectory
from eigenfail.values.measures import Measures
from eigenfail.values.requirements import AnyRequirement, EpisodeJudge, Requirements
from eigenfail.values.scene import Scene
from eigenfail.values.shapes import White
from eigenfail.values.showing import Brief

# The largest integer that databases hold.
MAX_SEED = 2**63 - 1


MAX_WALL_S = 7 * 86_400.0
"""The longest credible duration of an episode: a worker may report any number. [s]"""


# Nothing that a task or a result holds refers to another one, so they form no cycles. A hub holds
# thousands of them, and the garbage collector would take a tenth of its time to visit them all.


class PriorSource(msgspec.Struct, frozen=True, gc=False, tag="prior"):
    """Draw every z_t from the disturbance model itself."""


class Importance(StrEnum):
    """An importance function: how close an episode is to a collision, after each step.

    Splitting continues the episodes with its largest values so far. The function changes how
    precise an estimate is, but not the estimated quantity.
    """

    REQUIRED_BRAKING = "required_braking"
    TIME_TO_COLLISION = "time_to_collision"
    DISTANCE = "distance"


class TrajectorySource(msgspec.Struct, frozen=True, eq=False, gc=False, tag="trajectory"):
    """Inject this z, shape (steps, channels); after its end no noise is injected.

    Attributes:
        importance: importance function whose values the result is to have; None for no values.
        seed: seed of the episode to replay. The replay has the same seed, so that the scenario's
            draws are repeated. None: the seed is `episode_seed`.
    """

    z: Floats
    importance: Importance | None = None
    seed: Annotated[int, msgspec.Meta(ge=0, le=MAX_SEED)] | None = None


class PolicySource(msgspec.Struct, frozen=True, gc=False, tag="policy"):
    """Let this version of the adversary's policy choose z_t from its observations."""

    version: int


Source = PriorSource | TrajectorySource | PolicySource


class EpisodeTask(msgspec.Struct, frozen=True, eq=False, gc=False):
    """An episode to run.

    Attributes:
        index: its number within the campaign, from 0.
        seed: seed of all randomness in the episode: the source's seed, or else `episode_seed`.
        source: source of its disturbances.
    """

    index: int
    seed: int
    source: Source

    @property
    def source_kind(self) -> str:
        """Kind of its disturbance source: prior, trajectory or policy."""
        return str(self.source.__struct_config__.tag)

    @property
    def importance(self) -> Importance | None:
        """Importance function whose values its result is to have; None for no values."""
        return self.source.importance if isinstance(self.source, TrajectorySource) else None


class EpisodeSetup(msgspec.Struct, frozen=True):
    """The setup that all episodes of a campaign share: names of plug-ins, and their settings.

    Attributes:
        requirements: conditions that an episode must satisfy; if absent, no collision.
        importance: requirement that guides searches in safe episodes; if absent, the
            requirements.
    """

    simulator: str
    scenario: str
    scenario_parameters: dict[str, Any]
    planner: str
    planner_settings: dict[str, Any]
    disturbance: DisturbanceModel
    scene_every: int = 50
    # Absent from fingerprints and messages where it is not given, as in campaigns.
    requirements: Requirements | msgspec.UnsetType = msgspec.UNSET
    importance: AnyRequirement | msgspec.UnsetType = msgspec.UNSET

    def make_judge(self) -> EpisodeJudge | None:
        """Return the judge of the episodes; None if no requirements are named."""
        if isinstance(self.requirements, msgspec.UnsetType):
            return None
        followed = self.importance
        return EpisodeJudge(
            self.requirements, None if isinstance(followed, msgspec.UnsetType) else followed
        )


ERRORED = "errored"
"""Shown state of an episode that could not be completed, and of a campaign of only such ones."""


class Outcome(StrEnum):
    """How an episode ended.

    A violation is a failure without a collision: the episode violates another requirement of its
    campaign. A collision that no requirement forbids counts as safe.

    An errored episode could not be completed, which is not evidence about the ego. It is stored and
    sent as "failed", but shown as `word`. "errored" is accepted in place of "failed".
    """

    COLLISION = "collision"
    VIOLATION = "violation"
    SAFE = "safe"
    ERRORED = "failed"

    @classmethod
    def _missing_(cls, value: object) -> "Outcome | None":
        return cls.ERRORED if value == ERRORED else None

    @property
    def word(self) -> str:
        """The outcome as shown to users: collision, violation, safe or errored."""
        return ERRORED if self is Outcome.ERRORED else self.value

    @property
    def is_failure(self) -> bool:
        """True if the episode violates a requirement of its campaign, by a collision or not."""
        return self in FAILURES


FAILURES = (Outcome.COLLISION, Outcome.VIOLATION)
"""The outcomes that are failures."""


class EpisodeFault(msgspec.Struct, frozen=True):
    """Why an episode errored.

    `kind` is infrastructure, simulator, planner, solver or input. The message is bounded in length,
    and free of characters that a message or a database refuses.
    """

    kind: str
    message: str

    def __post_init__(self) -> None:
        """Clean the texts, which may come from plug-ins and workers."""
        msgspec.structs.force_setattr(self, "kind", clean_text(self.kind))
        msgspec.structs.force_setattr(self, "message", clean_text(self.message))


class EpisodeResult(Brief, msgspec.Struct, frozen=True, eq=False, gc=False):
    """The result of one episode.

    Attributes:
        measures: None if the episode errored.
        noise: the disturbances injected; empty if the episode errored before its first step.
        states: states that the adversary observed, shape (steps, count_state(channels)), for
            policy sources.
        importance: importance after each step, shape (steps,), if its source requests it.
        scene: the full trajectories, for failures and a sample of all others.
        requirements: robustness of each requirement of its campaign, in the requirement's unit and
            in their order; empty if the campaign names none.
        wall_s: time the worker spent on the episode; not part of the digest.
        source: kind of its disturbance source: prior, trajectory or policy.
    """

    index: int
    seed: int
    outcome: Outcome
    steps: int
    noise: NoiseTrajectory
    source: str
    measures: Measures | None = None
    states: Floats | None = None
    importance: Floats | None = None
    scene: Scene | None = None
    fault: EpisodeFault | None = None
    wall_s: float = 0.0
    requirements: tuple[float | None, ...] = ()

    @property
    def is_failure(self) -> bool:
        """True if the episode violates a requirement of its campaign."""
        return self.outcome.is_failure

    @property
    def believed_wall_s(self) -> float:
        """Time the worker spent on the episode; 0 if the reported time is not credible. [s]"""
        return self.wall_s if 0.0 <= self.wall_s <= MAX_WALL_S else 0.0

    def digest(self) -> str:
        """Return the SHA-256 of the course: the same for an episode and its exact replay.

        The digest covers the outcome, steps, noise and measures, but not the index, the source or
        the time. It also covers named requirements, and the shape if the noise does not follow from
        z and sigma alone.
        """
        measures = self.measures or Measures(float("nan"))
        parts = (self.outcome.encode(), struct.pack("<q", self.steps), measures.packed())
        arrays = (self.noise.z.tobytes(), self.noise.sigma.tobytes())
        fault = self.fault.kind.encode() if self.fault else b""
        plain = self.noise.shape == White() or not self.noise.z.size
        shape = () if plain else (msgspec.json.encode(self.noise.shape),)
        judged: tuple[bytes, ...] = ()
        if measures.nearest_m is not None:
            judged = (struct.pack("<dq", measures.nearest_m, measures.violated or 0),)
        return hashlib.sha256(b"\x00".join((*parts, *arrays, fault, *shape, *judged))).hexdigest()


def unrunnable(task: EpisodeTask, fault: EpisodeFault) -> EpisodeResult:
    """Return the result of an episode that ended before its first step, with its fault."""
    nothing = np.zeros((0, 2), np.float32)
    return EpisodeResult(
        index=task.index,
        seed=task.seed,
        outcome=Outcome.ERRORED,
        steps=0,
        noise=NoiseTrajectory(nothing, nothing),
        source=task.source_kind,
        fault=fault,
    )


def episode_seed(campaign_seed: int, index: int) -> int:
    """Return the seed of an episode, which depends only on the campaign's seed and the index."""
    state = np.random.SeedSequence([campaign_seed, index]).generate_state(1, np.uint64)
    return int(state[0]) & MAX_SEED


def learner_seed(campaign_seed: int) -> int:
    """Return the seed of the learner's draws, which differs from the seeds of all episodes."""
    state = np.random.SeedSequence([campaign_seed], spawn_key=(0,)).generate_state(1, np.uint64)
    return int(state[0]) & MAX_SEED
