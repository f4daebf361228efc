"""How long an episode of each campaign takes."""

from math import inf

UNKNOWN_PACE_S = 0.1
"""Until the first result."""

SHORTEST_S = 1e-4
LONGEST_S = 3_600.0
"""No worker can have a campaign believed to be slower than that, whatever it tells."""

PACE_SMOOTHING = 0.2


class Paces:
    """Learns from the times that results tell."""

    def __init__(self) -> None:
        self._s: dict[int, float] = {}

    def learn(self, campaign: int, wall_s: float) -> None:
        """An episode took so long."""
        pace_s = self._s.get(campaign, wall_s)
        self._s[campaign] = pace_s + PACE_SMOOTHING * (wall_s - pace_s)

    def of(self, campaign: int) -> float:
        """What an episode takes of a worker, as far as is known. [s]"""
        return max(self._s.get(campaign, UNKNOWN_PACE_S), SHORTEST_S)

    def forget(self, campaign: int) -> None:
        """It is over."""
        self._s.pop(campaign, None)


def told(wall_s: float) -> float | None:
    """A time that came over the wire, within bounds; None if it is no time at all. [s]"""
    return min(wall_s, LONGEST_S) if 0.0 < wall_s < inf else None
