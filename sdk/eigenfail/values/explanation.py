"""An episode with the planner's own account of each step, beside the truth."""

import msgspec

from eigenfail.values.episode import EpisodeResult, Outcome
from eigenfail.values.scene import Scene
from eigenfail.values.showing import Brief

Account = dict[str, str | float]

Path = tuple[tuple[float, float], ...]
"""Positions of a vehicle's centre (x, y), in the order in which it means to pass them [m]."""


class ExplainedStep(msgspec.Struct, frozen=True):
    """One step: what the planner says of it, and what was so.

    Attributes:
        acceleration_mps2: what the planner asked for; steering_rad likewise.
        account: what it says; empty for a planner that explains nothing.
        disturbance: a_t / sigma_t of this step, (longitudinal, lateral) [sigma].
        gap_m: from the truck's front to the nearest vehicle's rear bumper along the road, in truth.
        closing_mps: speed at which this gap closes, in truth.
        path: where the planner means to drive from here, the present position first; empty for a
            planner that tells none.
    """

    time_s: float
    acceleration_mps2: float
    steering_rad: float
    account: Account
    disturbance: tuple[float, float]
    gap_m: float | None = None
    closing_mps: float | None = None
    path: Path = ()


class ExplainedEpisode(msgspec.Struct, frozen=True, eq=False):
    """An episode that was run for the sake of its explanation.

    Attributes:
        result: what came of it, as of any episode.
        steps: those in which the planner decided; without the truth if the episode failed.
    """

    result: EpisodeResult
    steps: tuple[ExplainedStep, ...]


class Replayed(msgspec.Struct, frozen=True):
    """What was stored beside what came of it now.

    Attributes:
        differing: the versions under which it was run that are not those of now, where it is not
            the same; null if they are not known.
    """

    index: int
    stored_outcome: Outcome
    stored_digest: str
    outcome: Outcome
    digest: str
    same: bool
    differing: tuple[str, ...] | None = None


class Explanation(Brief, msgspec.Struct, frozen=True, eq=False):
    """A stored episode, run again and accounted for.

    Attributes:
        episode: as campaign/index.
        planner: its name.
        verdict: whether the replay is the stored episode.
        note: what must be known about the planner's account; may be empty.
        steps: those asked for; the story is of all.
        story: what happened, a sentence for each thing of note, in the order of time.
        scene: of the replay, where the stored episode kept none and the replay is the same.
    """

    episode: str
    planner: str
    replayed: Replayed
    verdict: str
    note: str
    steps: tuple[ExplainedStep, ...]
    story: tuple[str, ...]
    scene: Scene | None = None
