"""What is asked of an episode, and what comes of it."""

import hashlib
import struct
from enum import StrEnum
from typing import Any

import msgspec
import numpy as np

from eigenfail.values.arrays import Floats
from eigenfail.values.disturbance import DisturbanceModel, NoiseTrajectory, White
from eigenfail.values.scene import Scene
from eigenfail.values.showing import Brief

FIRST_MEASURES = 4
"""How many measures the first release had."""

DIGESTED_MEASURES = 12
"""How many measures a digest covers: those that came later follow from the same course."""


class PriorSource(msgspec.Struct, frozen=True, tag="prior"):
    """Draw every z_t from the disturbance model itself."""


class TrajectorySource(msgspec.Struct, frozen=True, eq=False, tag="trajectory"):
    """Inject this z, shape (steps, 2); after its end no noise is injected."""

    z: Floats


class PolicySource(msgspec.Struct, frozen=True, tag="policy"):
    """Let this version of the adversary's policy choose z_t from what it sees."""

    version: int


Source = PriorSource | TrajectorySource | PolicySource


class EpisodeTask(msgspec.Struct, frozen=True, eq=False):
    """One episode to be run.

    Attributes:
        index: its number within the campaign, from 0.
        seed: of everything random in it; see `randomness.episode_seed`.
        source: where its disturbances come from.
    """

    index: int
    seed: int
    source: Source

    @property
    def source_kind(self) -> str:
        """Kind of its disturbance source: prior, trajectory or policy."""
        return str(self.source.__struct_config__.tag)


class EpisodeSetup(msgspec.Struct, frozen=True):
    """What all episodes of a campaign share, by plug-in names and their settings."""

    simulator: str
    scenario: str
    scenario_parameters: dict[str, Any]
    planner: str
    planner_settings: dict[str, Any]
    disturbance: DisturbanceModel
    scene_every: int = 50


class Outcome(StrEnum):
    """How an episode ended; `failed` means that it could not be run, not that the ego crashed."""

    COLLISION = "collision"
    SAFE = "safe"
    FAILED = "failed"


class EpisodeFault(msgspec.Struct, frozen=True):
    """Why an episode could not be run.

    `kind` is infrastructure, simulator, planner, solver or input.
    """

    kind: str
    message: str


class Measures(msgspec.Struct, frozen=True):
    """What was measured over one episode; formulas and sources are in docs/measures.md.

    Times are in seconds from the start. Violations are those of the vehicle that was struck or,
    without a collision, the earliest of any. What an older release did not measure is None.

    Attributes:
        robustness_m: smallest distance between the footprints of the ego and any other vehicle;
            0 on a collision.
        severity: ||v_ego - v_actor||² at the collision [m²/s²]; None without one.
        min_ttc_s: smallest time to collision; None if the ego never closed in.
        max_drac_mps2: largest deceleration required to avoid the crash; None if it never closed in.
        ttc_violated_s: when the time to collision first fell below 1.5 s; None if never.
        drac_violated_s: when DRAC first exceeded 7.0 m/s²; None if never.
        drac_at_warning_mps2: DRAC at `ttc_violated_s`, where a collision is classified.
        collided_s: when the collision was seen; None without one.
        left_road_s: when the ego was first off its road; None if never.
        max_jerk_mps3: largest |change| of the acceleration applied, by time.
        hard_brakings: how often braking harder than 3.0 m/s² began.
        clipped_steps: in how many steps the planner asked for more than the truck can do.
        final_drac_mps2: DRAC at the last step, the largest of any vehicle; 0 if the ego closed in
            on nobody, None on a collision.
    """

    robustness_m: float
    severity: float | None = None
    min_ttc_s: float | None = None
    max_drac_mps2: float | None = None
    ttc_violated_s: float | None = None
    drac_violated_s: float | None = None
    drac_at_warning_mps2: float | None = None
    collided_s: float | None = None
    left_road_s: float | None = None
    max_jerk_mps3: float | None = None
    hard_brakings: int | None = None
    clipped_steps: int | None = None
    final_drac_mps2: float | None = None

    def packed(self) -> bytes:
        """The first twelve of them as little-endian doubles, NaN for None, for a digest.

        Whatever is None at the end does not count beyond the fourth: so results that were stored
        before there were more than four measures keep their digests.
        """
        numbers = list(msgspec.structs.astuple(self)[:DIGESTED_MEASURES])
        while len(numbers) > FIRST_MEASURES and numbers[-1] is None:
            numbers.pop()
        return struct.pack(
            f"<{len(numbers)}d", *(float("nan") if n is None else n for n in numbers)
        )


class EpisodeResult(Brief, msgspec.Struct, frozen=True, eq=False):
    """What came of one episode.

    Attributes:
        measures: None if the episode failed.
        noise: the disturbances injected; empty if the episode failed before its first step.
        states: what the adversary saw, shape (steps, len(policy.STATE)), for policy sources.
        scene: the full trajectories, for collisions and a sample of the others.
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
    scene: Scene | None = None
    fault: EpisodeFault | None = None
    wall_s: float = 0.0

    @property
    def is_failure(self) -> bool:
        """Whether the ego collided."""
        return self.outcome is Outcome.COLLISION

    def digest(self) -> str:
        """SHA-256 of what happened: the same for an episode and for its replay, bit for bit.

        It covers the outcome, steps, noise and measures; not the index, the source or the time.
        A shape adds to it where there is noise whose metres do not follow from z and sigma alone.
        """
        packed = (self.measures or Measures(float("nan"))).packed()
        parts = (self.outcome.encode(), struct.pack("<q", self.steps), packed)
        arrays = (self.noise.z.tobytes(), self.noise.sigma.tobytes())
        fault = self.fault.kind.encode() if self.fault else b""
        plain = self.noise.shape == White() or not self.noise.z.size
        shape = () if plain else (msgspec.json.encode(self.noise.shape),)
        return hashlib.sha256(b"\x00".join((*parts, *arrays, fault, *shape))).hexdigest()


def unrunnable(task: EpisodeTask, fault: EpisodeFault) -> EpisodeResult:
    """The result of an episode that did not get as far as its first step."""
    nothing = np.zeros((0, 2), np.float32)
    return EpisodeResult(
        index=task.index,
        seed=task.seed,
        outcome=Outcome.FAILED,
        steps=0,
        noise=NoiseTrajectory(nothing, nothing),
        source=task.source_kind,
        fault=fault,
    )
