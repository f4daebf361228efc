"""Settings of `mixture_ce`."""

from typing import Annotated

import msgspec
from msgspec import Meta

from eigenfail_services.methods import Amount, UpToOne

STEPS_PER_JITTER = 30
"""Least number of steps of an episode for each step of shift, so that shifts are small."""

FIRST_SHARE = 0.08

DRAWS_PER_ELITE = 4
"""Least number of draws from the prior for each trajectory that the mixture is fitted to."""

ROUND_SHARE, SMALLEST_ROUND = 0.04, 10


class MixtureCeSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of `mixture_ce`."""

    initial: Annotated[
        Amount | None,
        Meta(
            description="episodes drawn from p(x) at first; none: 8 %, at least four for each of "
            "the elite, at most half"
        ),
    ] = None
    round_size: Annotated[
        Amount | None,
        Meta(description="episodes between two fits; none: 4 %, at least 10"),
    ] = None
    elite: Annotated[Amount, Meta(description="trajectories to which the mixture is fitted")] = 20
    likely_share: Annotated[
        UpToOne, Meta(description="share of the elite in the newest failures")
    ] = 0.5
    scale: Annotated[
        float, Meta(ge=0.1, le=10.0, description="initial factor of the means of samples")
    ] = 1.15
    target_rate: Annotated[
        float,
        Meta(
            gt=0.0,
            lt=1.0,
            description="failure rate towards which the factor is adapted; lower: likelier "
            "failures, fewer of them",
        ),
    ] = 0.2
    jitter: Annotated[
        int,
        Meta(
            ge=0,
            le=10_000,
            description="steps over which means are averaged to either side; at most 1 in 30",
        ),
    ] = 3
    memory: Annotated[int, Meta(ge=10, le=1_000_000, description="trajectories in memory")] = 10_000

    def choose_jitter(self, horizon: int) -> int:
        """Return the averaging to either side, so small that an episode stays what it is."""
        return min(self.jitter, horizon // STEPS_PER_JITTER)

    def size_initial(self, episodes: int) -> int:
        """Return the number of episodes from the prior."""
        if self.initial is not None:
            return self.initial
        # With fewer, the elite would hardly be better than the draws that it comes from.
        fewest = min(DRAWS_PER_ELITE * self.elite, episodes // 2)
        return max(round(FIRST_SHARE * episodes), fewest)

    def size_round(self, episodes: int) -> int:
        """Return the number of episodes of each later round."""
        return self.round_size or max(SMALLEST_ROUND, round(ROUND_SHARE * episodes))
