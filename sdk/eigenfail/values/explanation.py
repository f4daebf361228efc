"""An episode with the planner's own account of each step, beside the truth."""

import msgspec

from eigenfail.values.episode import EpisodeResult

Account = dict[str, str | float]


class ExplainedStep(msgspec.Struct, frozen=True):
    """One step: what the planner says of it, and what was so.

    Attributes:
        acceleration_mps2: what the planner asked for; steering_rad likewise.
        account: what it says; empty for a planner that explains nothing.
        disturbance: a_t / sigma_t of this step, (longitudinal, lateral) [sigma].
        gap_m: from the truck's front to the nearest vehicle's rear bumper along the road, in truth.
        closing_mps: speed at which this gap closes, in truth.
    """

    time_s: float
    acceleration_mps2: float
    steering_rad: float
    account: Account
    disturbance: tuple[float, float]
    gap_m: float | None = None
    closing_mps: float | None = None


class ExplainedEpisode(msgspec.Struct, frozen=True, eq=False):
    """An episode that was run for the sake of its explanation.

    Attributes:
        result: what came of it, as of any episode.
        steps: those in which the planner decided; without the truth if the episode failed.
    """

    result: EpisodeResult
    steps: tuple[ExplainedStep, ...]
