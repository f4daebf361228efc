"""What workers say that they hold and the hub does not know of yet: pure bookkeeping."""

from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

from eigenfail.values import EpisodeTask
from eigenfail.wire.claims import FINISHED, Claim
from eigenfail_services.hub.waiting import Waiting

Key = tuple[int, int]
"""Campaign and index of an episode."""

Fingerprint = Callable[[int, EpisodeTask], bytes]
"""Of a campaign's task, as workers tell it of what they hold."""


class Claimed(NamedTuple):
    """An episode that waits, and a worker that says that it holds it: the same task, or another."""

    worker: bytes
    key: Key
    is_right: bool


class Claims:
    """Who claims which episode, with the fingerprint of the task that they hold.

    A claim waits here until its episode is proposed, has a result, or its worker takes it back.
    There are no more of a worker than one hello may bring.
    """

    def __init__(self) -> None:
        self._told: dict[int, dict[int, dict[bytes, bytes]]] = {}
        self._of: dict[bytes, set[Key]] = {}
        self._to_look_at: set[int] = set()

    def take(self, worker: bytes, claims: Iterable[Claim]) -> None:
        """What a worker says in its hello, besides what it said before."""
        for claim in claims:
            episodes = self._told.setdefault(claim.campaign, {})
            episodes.setdefault(claim.index, {})[worker] = claim.task
            self._of.setdefault(worker, set()).add((claim.campaign, claim.index))
            self.look_again(claim.campaign)

    def look_again(self, campaign: int) -> None:
        """Something of a campaign waits that did not before."""
        self._to_look_at.add(campaign)

    def matching(self, waiting: Waiting, fingerprint: Fingerprint) -> Iterator[Claimed]:
        """What waits, and somebody claims; with this, the claim is dealt with.

        Campaigns of which nothing new waits or is claimed since the last call are passed over.
        """
        while self._to_look_at:
            campaign = self._to_look_at.pop()
            for key, worker, told in self.on(campaign):
                task = waiting.of(campaign).get(key[1])
                if task is not None:
                    self.discard(worker, key)
                    is_right = told in (FINISHED, fingerprint(campaign, task))
                    yield Claimed(worker, key, is_right)

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
