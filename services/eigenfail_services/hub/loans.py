"""Which episode is with which worker."""

from collections import defaultdict

from eigenfail.values import EpisodeTask
from eigenfail_services.hub.claims import Key
from eigenfail_services.hub.dealer import Dealer
from eigenfail_services.hub.seats import Loan, Seat


class Loans:
    """Keeps seats, campaigns and the dealer at one mind on what is held; each change is O(log n).

    Args:
        seats: who is here, by their connections.
        dealer: told of all that goes out and comes back.
    """

    def __init__(self, seats: dict[bytes, Seat], dealer: Dealer) -> None:
        self._seats = seats
        self._dealer = dealer
        self._holders: defaultdict[int, dict[int, bytes]] = defaultdict(dict)

    def busy(self, campaign: int) -> bool:
        """Whether any episode of a campaign is with a worker."""
        return bool(self._holders.get(campaign))

    def held(self, key: Key) -> EpisodeTask | None:
        """What somebody holds of an episode; None if nobody does."""
        worker = self._holders.get(key[0], {}).get(key[1])
        return None if worker is None else self._seats[worker].held[key]

    def lend(self, worker: bytes, key: Key, task: EpisodeTask) -> None:
        """A worker has it now, which its campaign is charged for."""
        seat = self._seats[worker]
        work_s = self._dealer.work_s(key[0], seat)
        seat.lend(key, task, work_s)
        self._holders[key[0]][key[1]] = worker
        self._dealer.lent(key[0], seat, work_s)
        self._dealer.look(worker, seat)

    def end(self, key: Key) -> Loan:
        """Nobody has it any more; what it was charged as stays charged."""
        worker = self._holders[key[0]].pop(key[1])
        seat = self._seats[worker]
        ended = seat.give_back(key)
        self._dealer.look(worker, seat)
        return ended

    def settle(self, key: Key, by: bytes | None) -> Loan | None:
        """It has a result: what who brought it held of it; what another holds is undone.

        Args:
            key: of the episode.
            by: whose result it is; None for whoever holds the episode.
        """
        holder = self._holders.get(key[0], {}).get(key[1])
        if holder is None:
            return None
        if by in (None, holder):
            return self.end(key)
        self.undo(key)
        return None

    def undo(self, key: Key) -> EpisodeTask:
        """Nobody has it any more, nor did anybody run it."""
        ended = self.end(key)
        self._dealer.lent(key[0], ended.seat, -ended.work_s)
        return ended.task

    def end_all(self, campaign: int) -> None:
        """Nobody has anything of a campaign any more."""
        for index in [*self._holders.get(campaign, ())]:
            self.end((campaign, index))
        self._holders.pop(campaign, None)
