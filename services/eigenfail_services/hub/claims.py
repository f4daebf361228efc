"""What workers say that they hold and the hub does not know of yet: pure bookkeeping."""

from collections.abc import Iterable

from eigenfail.wire.claims import Claim

Key = tuple[int, int]
"""Campaign and index of an episode."""


class Claims:
    """Who claims which episode, with the fingerprint of the task that they hold.

    A claim waits here until its episode is proposed, has a result, or its worker takes it back.
    There are no more of a worker than one hello may bring.
    """

    def __init__(self) -> None:
        self._told: dict[int, dict[int, dict[bytes, bytes]]] = {}
        self._of: dict[bytes, set[Key]] = {}

    def take(self, worker: bytes, claims: Iterable[Claim]) -> None:
        """What a worker says in its hello, besides what it said before."""
        for claim in claims:
            episodes = self._told.setdefault(claim.campaign, {})
            episodes.setdefault(claim.index, {})[worker] = claim.task
            self._of.setdefault(worker, set()).add((claim.campaign, claim.index))

    def on(self, campaign: int) -> list[tuple[Key, bytes, bytes]]:
        """Episode, worker, fingerprint, of one campaign; who spoke first comes first."""
        return [
            ((campaign, index), worker, told)
            for index, workers in self._told.get(campaign, {}).items()
            for worker, told in workers.items()
        ]

    def of(self, worker: bytes) -> set[Key]:
        """What a worker claims."""
        return set(self._of.get(worker, ()))

    def discard(self, worker: bytes, key: Key) -> None:
        """A worker claims that episode no longer."""
        campaign, index = key
        del self._told[campaign][index][worker]
        self._of[worker].remove(key)
        if not self._told[campaign][index]:
            del self._told[campaign][index]
        if not self._told[campaign]:
            del self._told[campaign]
        if not self._of[worker]:
            del self._of[worker]

    def leave(self, worker: bytes) -> None:
        """A worker claims nothing any more."""
        for key in self.of(worker):
            self.discard(worker, key)

    def settle(self, key: Key) -> None:
        """Nobody needs to hold that episode any more."""
        campaign, index = key
        for worker in [*self._told.get(campaign, {}).get(index, ())]:
            self.discard(worker, key)

    def withdraw(self, campaign: int) -> None:
        """Nobody needs to hold anything of that campaign."""
        for index in [*self._told.get(campaign, ())]:
            self.settle((campaign, index))
