"""Settings of subset simulation, and how many samples a budget allows."""

from bisect import bisect_right
from math import ceil
from typing import Annotated

import msgspec
from msgspec import Meta

from eigenfail.errors import InvalidValue
from eigenfail_services.statistics.subset_estimate import SubsetSettings

PLANNED_LEVELS = 7
FEWEST_SAMPLES = 20
MOST_SAMPLES = 100_000


class SubsetMethodSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of `subset`.

    Without `samples`, a level has as many as the budget allows over seven levels in each run:
    enough for a probability of 1e-6 at a share of 0.1, and some more.
    """

    samples: Annotated[
        Annotated[int, Meta(ge=FEWEST_SAMPLES, le=MOST_SAMPLES)] | None,
        Meta(description="samples on each level of a run; none given: what the budget allows"),
    ] = None
    level_share: Annotated[
        float, Meta(ge=0.05, le=0.5, description="share of them that is to reach the next level")
    ] = 0.1
    acceptance: Annotated[
        float, Meta(ge=0.1, le=0.9, description="share of the moves that is to be accepted")
    ] = 0.4
    most_levels: Annotated[int, Meta(ge=1, le=100, description="levels at most")] = 20
    runs: Annotated[
        int, Meta(ge=1, le=10, description="independent runs, to be compared with each other")
    ] = 2
    round_size: Annotated[
        int, Meta(ge=1, le=100_000, description="episodes in a round at most")
    ] = 10_000

    def check_budget(self, episodes: int) -> None:
        """Raises InvalidValue if the budget allows too few samples."""
        self.within(episodes)

    def within(self, episodes: int) -> SubsetSettings:
        """Settings of one run within a budget of all of them.

        Raises:
            InvalidValue: the budget allows too few samples.
        """
        samples = self.samples or self._affordable(episodes)
        if samples < FEWEST_SAMPLES:
            raise InvalidValue(
                "episodes",
                f"{episodes} are fewer than {FEWEST_SAMPLES} samples on each of {PLANNED_LEVELS} "
                f"levels in {self.runs} runs, which take {self._spent(FEWEST_SAMPLES)}.",
                "Give more episodes: with tens of thousands the estimate is good.",
            )
        return SubsetSettings(
            samples=samples,
            share=self.level_share,
            acceptance=self.acceptance,
            most_levels=self.most_levels,
        )

    def _affordable(self, episodes: int) -> int:
        """The most samples of a level with which the planned levels are within the budget."""
        counts = range(MOST_SAMPLES + 1)
        return bisect_right(counts, episodes, lo=FEWEST_SAMPLES, key=self._spent) - 1

    def _spent(self, samples: int) -> int:
        """Episodes of all runs: on all levels but the first one, the seeds were run before."""
        seeds = round(self.level_share * samples)
        moves = (ceil(samples / seeds) - 1) * seeds
        return self.runs * (samples + (PLANNED_LEVELS - 1) * moves)
