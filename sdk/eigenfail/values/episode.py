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
"""The longest that an episode is believed to have taken: a worker may report any number. [s]"""


# Nothing that a task or a result holds refers to another one, so they form no cycles. A hub holds
# thousands of them, and the garbage collector would take a tenth of its time to visit them all.


class PriorSource(msgspec.Struct, frozen=True, gc=False, tag="prior"):
    """Draw every z_t from the disturbance model itself."""


class Importance(StrEnum):
    """An importance function: how close an episode is to a collision, after each step.

    Splitting continues the episodes in which it has been largest. It decides how precise an
    estimate is, and not what it estimates.
    """

    REQUIRED_BRAKING = "required_braking"
    TIME_TO_COLLISION = "time_to_collision"
    DISTANCE = "distance"


class TrajectorySource(msgspec.Struct, frozen=True, eq=False, gc=False, tag="trajectory"):
    """Inject this z, shape (steps, channels); after its end no noise is injected.

    Attributes:
        importance: importance function whose values the result is to have; None for no values.
        seed: seed of the episode that is replayed, which the replay then has as well: whatever the
            scenario draws is drawn again. None: the episode has a seed of its own.
    """

    z: Floats
    importance: Importance | None = None
    seed: Annotated[int, msgspec.Meta(ge=0, le=MAX_SEED)] | None = None


class PolicySource(msgspec.Struct, frozen=True, gc=False, tag="policy"):
    """Let this version of the adversary's policy choose z_t from what it sees."""

    version: int


Source = PriorSource | TrajectorySource | PolicySource


class EpisodeTask(msgspec.Struct, frozen=True, eq=False, gc=False):
    """One episode to be run.

    Attributes:
        index: its number within the campaign, from 0.
        seed: seed of everything random in it: that of its source, or else `episode_seed`.
        source: where its disturbances come from.
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
        requirements: what an episode must satisfy; where they are absent, no collision.
        importance: what searches follow in safe episodes; where it is absent, the requirements.
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
        """Return what judges the episodes; None if only no collision is required."""
        if isinstance(self.requirements, msgspec.UnsetType):
            return None
        followed = self.importance
        return EpisodeJudge(
            self.requirements, None if isinstance(followed, msgspec.UnsetType) else followed
        )


ERRORED = "errored"
"""What people call an episode that could not be completed, and a campaign of only such episodes."""


class Outcome(StrEnum):
    """How an episode ended.

    A violation is a failure without a collision: the episode violates another requirement of its
    campaign. A collision that no requirement forbids counts as safe.

    An episode that errored could not be completed, which says nothing about the ego. "failed" is
    only its stored and sent spelling: people read `word`, and "errored" is accepted wherever an
    outcome is.
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
        """The outcome as people read it: collision, violation, safe or errored."""
        return ERRORED if self is Outcome.ERRORED else self.value

    @property
    def is_failure(self) -> bool:
        """Whether the episode violates a requirement of its campaign, by a collision or not."""
        return self in FAILURES


FAILURES = (Outcome.COLLISION, Outcome.VIOLATION)
"""The outcomes that are failures."""


class EpisodeFault(msgspec.Struct, frozen=True):
    """Why an episode errored.

    `kind` is infrastructure, simulator, planner, solver or input. The message is bounded, and holds
    no character that a message or a database refuses, wherever it came from.
    """

    kind: str
    message: str

    def __post_init__(self) -> None:
        """Clean the texts, which plug-ins and workers have a hand in."""
        msgspec.structs.force_setattr(self, "kind", clean_text(self.kind))
        msgspec.structs.force_setattr(self, "message", clean_text(self.message))


class EpisodeResult(Brief, msgspec.Struct, frozen=True, eq=False, gc=False):
    """The result of one episode.

    Attributes:
        measures: None if the episode errored.
        noise: the disturbances injected; empty if the episode errored before its first step.
        states: what the adversary saw, shape (steps, count_state(channels)), for policy
            sources.
        importance: importance after each step, shape (steps,), where its source asks for it.
        scene: the full trajectories, for failures and a sample of the others.
        requirements: robustness of each requirement of its campaign, in its unit and in their
            order; empty if only no collision is required.
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
        """Whether it violates a requirement of its campaign."""
        return self.outcome.is_failure

    @property
    def believed_wall_s(self) -> float:
        """Time the worker spent on the episode; 0 if it reports what no episode takes. [s]"""
        return self.wall_s if 0.0 <= self.wall_s <= MAX_WALL_S else 0.0

    def digest(self) -> str:
        """SHA-256 of what happened: the same for an episode and for its replay, bit for bit.

        It covers the outcome, steps, noise and measures; not the index, the source or the time.
        Requirements that are named add to it.
        A shape adds to it if there is noise that does not follow from z and sigma alone.
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
    """The result of an episode that did not get as far as its first step."""
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
    """The seed of episode `index`: a function of the campaign's seed and the index alone."""
    state = np.random.SeedSequence([campaign_seed, index]).generate_state(1, np.uint64)
    return int(state[0]) & MAX_SEED


def learner_seed(campaign_seed: int) -> int:
    """The seed of the learner's own draws, apart from those of all episodes."""
    state = np.random.SeedSequence([campaign_seed], spawn_key=(0,)).generate_state(1, np.uint64)
    return int(state[0]) & MAX_SEED
