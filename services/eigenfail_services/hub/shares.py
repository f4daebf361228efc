"""Whose turn it is: the workers' time in proportion to weights, and nobody waits for ever.

Start-time fair queueing (Goyal, Vin and Cheng: Start-time Fair Queuing, IEEE/ACM Transactions on
Networking 5(5), 1997). Each campaign has a clock that goes on by the worker seconds that it is
given ÷ its weight, and the one whose clock is furthest behind has the next turn.

With turns of at most L_i worker seconds, and weights w_i, for campaigns that always have work:

- no two clocks are further apart than the largest L_k ÷ w_k, so that what a campaign was given
  differs from its weight's share of all by at most w_i × max L_k ÷ w_k worker seconds, for good;
- between two turns of a campaign the others are given at most sum over j of w_j L_i ÷ w_i + L_j;
  with equal turns these are at most sum over j of floor(w_j ÷ w_i) + 1 turns;
- who comes anew, or had nothing to do, waits for at most one turn of each of the others.
"""

from collections.abc import Collection

NORMAL = 1.0


class Shares:
    """The clocks of all campaigns. What a turn takes is charged when it is given, as estimated."""

    def __init__(self) -> None:
        self._weights: dict[int, float] = {}
        self._clocks_s: dict[int, float] = {}
        self._waited: frozenset[int] = frozenset()
        self._now_s = 0.0

    def weigh(self, campaign: int, weight: float) -> None:
        """From now on its clock goes by this weight, which is above 0."""
        self._weights[campaign] = weight

    def next(self, waiting: Collection[int]) -> int | None:
        """Whose turn it is of those that have work waiting.

        Who had none since the last turn begins where the others are: idle time is not saved up.
        """
        if not waiting:
            return None
        for campaign in set(waiting) - self._waited:
            self._clocks_s[campaign] = max(self._now_s, self._clocks_s.get(campaign, 0.0))
        self._waited = frozenset(waiting)
        chosen = min(waiting, key=lambda campaign: (self._clocks_s[campaign], campaign))
        self._now_s = self._clocks_s[chosen]
        return chosen

    def charge(self, campaign: int, worker_s: float) -> None:
        """It was given so much; below 0 what it was charged too much, or gave back."""
        gone_s = worker_s / self._weights.get(campaign, NORMAL)
        self._clocks_s[campaign] = self._clocks_s.get(campaign, self._now_s) + gone_s

    def forget(self, campaign: int) -> None:
        """It is over."""
        self._waited -= {campaign}
        self._weights.pop(campaign, None)
        self._clocks_s.pop(campaign, None)
