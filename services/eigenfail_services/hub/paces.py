"""How long an episode of each campaign takes, and so how many a worker should hold."""

from math import inf

WORK_AHEAD_S = 2.0
"""How much work a worker should hold, so that it never waits for the hub."""

UNKNOWN_PACE_S = 0.1
PACE_SMOOTHING = 0.2


class Paces:
    """Learns from the times that results tell."""

    def __init__(self) -> None:
        self._s: dict[int, float] = {}

    def learn(self, campaign: int, wall_s: float) -> None:
        """An episode took so long, if that is a time at all: it came over the wire."""
        if 0.0 < wall_s < inf:
            pace_s = self._s.get(campaign, wall_s)
            self._s[campaign] = pace_s + PACE_SMOOTHING * (wall_s - pace_s)

    def target(self, campaign: int) -> int:
        """How many episodes are work enough for one worker."""
        pace_s = max(self._s.get(campaign, UNKNOWN_PACE_S), 1e-4)
        return max(2, round(WORK_AHEAD_S / pace_s))

    def forget(self, campaign: int) -> None:
        """It is over."""
        self._s.pop(campaign, None)
