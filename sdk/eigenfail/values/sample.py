"""Episodes as points of a chart."""

import msgspec

from eigenfail.values.episode import Outcome

MOST_SAMPLES = 2_000
"""How many episodes a chart shows at most."""


class EpisodeSample(msgspec.Struct, frozen=True):
    """An episode that was completed, and how near it came.

    Attributes:
        robustness_m: None where it was not measured. [m]
    """

    index: int
    outcome: Outcome
    robustness_m: float | None
