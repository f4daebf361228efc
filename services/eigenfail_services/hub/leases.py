"""Who runs which episode: a state machine without a socket. Events in, assignments out."""

from collections import Counter, OrderedDict
from collections.abc import Callable, Collection
from math import ceil

import msgspec

from eigenfail.values import EpisodeTask
from eigenfail.wire.claims import FINISHED, same_task
from eigenfail.wire.messages import Hello
from eigenfail_services.hub.claims import Claims, Key
from eigenfail_services.hub.paces import Paces
from eigenfail_services.hub.seats import Seat

Fingerprint = Callable[[int, EpisodeTask], bytes]
"""Of a campaign's task, as workers tell it of what they hold."""


class Assignment(msgspec.Struct, frozen=True, eq=False):
    """These episodes go to this worker."""

    worker: bytes
    campaign: int
    tasks: tuple[EpisodeTask, ...]


class Leases:
    """Hands episodes to workers in batches, and takes them back from workers that are gone.

    Attributes:
        seats: who is here, by their connections.
    """

    def __init__(self) -> None:
        self.seats: dict[bytes, Seat] = {}
        self._claims = Claims()
        self._holder: dict[Key, bytes] = {}
        self._waiting: dict[int, OrderedDict[int, EpisodeTask]] = {}
        self._offered: dict[int, set[int]] = {}
        self._suspects: dict[Key, EpisodeTask] = {}
        self._brought: set[Key] = set()
        self._paces = Paces()

    def join(self, worker: bytes, hello: Hello, now_s: float) -> None:
        """A worker sits down, with what it says that it holds.

        If it had a seat before, by this connection or another one, it begins anew: all else that
        it held there is free again.
        """
        for old in [w for w, seat in self.seats.items() if w == worker or seat.is_of(hello)]:
            self.leave(old)
        self.seats[worker] = Seat(hello, now_s)
        self._claims.take(worker, hello.claims)

    def heard(self, worker: bytes, now_s: float) -> Seat | None:
        """A worker was heard; None if it has no seat."""
        if seat := self.seats.get(worker):
            seat.heard_s = now_s
        return seat

    def beat(self, worker: bytes, running: Key | None, named: Collection[Key]) -> None:
        """A worker says which episode it is running, if any, and names all that it holds.

        The first is the one to suspect if the worker is lost. What it does not name for long is
        free again: a lease or a result went astray.
        """
        seat = self.seats[worker]
        seat.running = running
        claimed = self._claims.of(worker)
        missed = seat.missed(seat.held.keys() | claimed, named)
        for key in missed & claimed:
            self._claims.discard(worker, key)
        self._free(seat, missed)

    def busy(self, campaign: int) -> bool:
        """Whether any episode of a campaign is with a worker."""
        return any(held == campaign for held, _ in self._holder)

    def silent(self, now_s: float, limit_s: float) -> list[bytes]:
        """The workers that were not heard for longer than the limit."""
        return [w for w, seat in self.seats.items() if now_s - seat.heard_s > limit_s]

    def excuse(self, away_s: float, now_s: float) -> None:
        """Nobody could be heard for a while: that is not the workers' silence."""
        for seat in self.seats.values():
            seat.heard_s = min(now_s, seat.heard_s + away_s)

    def leave(self, worker: bytes) -> None:
        """A worker goes, or begins anew: it lives, and has died of nothing that it ran.

        What it held waits again, at the front.
        """
        self._claims.leave(worker)
        if seat := self.seats.pop(worker, None):
            self._free(seat, set(seat.held))

    def lose(self, worker: bytes) -> None:
        """A worker is gone without a word: what it ran is suspected, the rest waits again."""
        seat = self.seats[worker]
        if seat.running is not None and seat.running in seat.held:
            del self._holder[seat.running]
            self._suspects[seat.running] = seat.held.pop(seat.running)
        self.leave(worker)

    def suspects(self) -> list[tuple[int, EpisodeTask]]:
        """Campaigns and episodes that were running as their workers were lost; nobody gets them."""
        return [(campaign, task) for (campaign, _), task in self._suspects.items()]

    def acquit(self, campaign: int, index: int) -> None:
        """An episode that was suspected waits again, at the front."""
        if task := self._suspects.pop((campaign, index), None):
            self._put_back(campaign, task)

    def _free(self, seat: Seat, keys: Collection[Key]) -> None:
        for key in reversed([key for key in seat.held if key in keys]):
            del self._holder[key]
            self._put_back(key[0], seat.held.pop(key))

    def _put_back(self, campaign: int, task: EpisodeTask) -> None:
        # Else it will be offered again, if it is still wanted: with the policy that it needs.
        if task.index in self._offered.get(campaign, ()):
            self._waiting[campaign][task.index] = task
            self._waiting[campaign].move_to_end(task.index, last=False)

    def offer(self, campaign: int, tasks: tuple[EpisodeTask, ...]) -> None:
        """These episodes are to be run, unless somebody is at it or has just brought them."""
        self._offered.setdefault(campaign, set()).update(task.index for task in tasks)
        waiting = self._waiting.setdefault(campaign, OrderedDict())
        waiting.update((task.index, task) for task in tasks if not self._is_out(campaign, task))

    def _is_out(self, campaign: int, task: EpisodeTask) -> bool:
        key = campaign, task.index
        if key in self._brought or key in self._suspects:
            return True
        if key not in self._holder:
            return False
        held = self.seats[self._holder[key]].held
        if same_task(held[key], task):
            return True
        del held[key], self._holder[key]
        return False

    def suspend(self, campaign: int) -> None:
        """Its learner is lost. What is leased stays so: the next one proposes the same again.

        It goes on from a checkpoint that was committed before any of this was leased, and in
        which the open rounds lie with their indices, seeds and policy versions.
        """
        self._waiting.pop(campaign, None)
        self._offered.pop(campaign, None)

    def withdraw(self, campaign: int) -> None:
        """Nothing of this campaign is to be run any more."""
        self._waiting.pop(campaign, None)
        self._offered.pop(campaign, None)
        self._paces.forget(campaign)
        self._claims.withdraw(campaign)
        self._suspects = {key: task for key, task in self._suspects.items() if key[0] != campaign}
        for key in [key for key in self._holder if key[0] == campaign]:
            del self.seats[self._holder.pop(key)].held[key]

    def bring(self, campaign: int, index: int, wall_s: float) -> None:
        """A result of the episode has come, and waits to be committed."""
        self._brought.add((campaign, index))
        self.settle(campaign, index, wall_s)

    def land(self, campaign: int, index: int) -> None:
        """What was brought was judged; if it is not wanted, the episode may be offered again."""
        self._brought.discard((campaign, index))

    def settle(self, campaign: int, index: int, wall_s: float) -> None:
        """The episode has a result, from whomever it came."""
        key = campaign, index
        self._claims.settle(key)
        self._suspects.pop(key, None)
        self._offered.get(campaign, set()).discard(index)
        if (holder := self._holder.pop(key, None)) is not None:
            del self.seats[holder].held[key]
        elif campaign in self._waiting:
            self._waiting[campaign].pop(index, None)
        if campaign in self._waiting:
            self._paces.learn(campaign, wall_s)

    def adopt(self, fingerprint: Fingerprint) -> set[tuple[bytes, int]]:
        """What waits, and a worker says that it holds, is leased to that worker.

        After a restart, a campaign goes on from a checkpoint that was committed before the first
        lease of the rounds in it, so a task that a worker took before is the one that waits here.
        Where it is not, as with a worker of another service, the fingerprints differ.

        Returns:
            Workers, and campaigns of which they hold something else than what is asked for here.
        """
        refused = set()
        for campaign, waiting in self._waiting.items():
            for key, worker, told in self._claims.on(campaign):
                if key[1] not in waiting:
                    continue
                self._claims.discard(worker, key)
                if told in (FINISHED, fingerprint(campaign, waiting[key[1]])):
                    self._lend(worker, key, waiting.pop(key[1]))
                else:
                    refused.add((worker, campaign))
        return refused

    def assign(self) -> list[Assignment]:
        """Hand out what waits: to the workers that hold least, from the campaign that has least."""
        assignments = []
        while (assignment := self._next()) is not None:
            assignments.append(assignment)
        return assignments

    def _next(self) -> Assignment | None:
        campaign = self._poorest_campaign()
        if campaign is None:
            return None
        target = self._paces.target(campaign)
        hungry = [w for w, s in self.seats.items() if s.is_hungry(target)]
        if not hungry:
            return None
        worker = min(hungry, key=lambda w: len(self.seats[w].held))
        return Assignment(worker, campaign, self._take(campaign, worker, target))

    def _poorest_campaign(self) -> int | None:
        waiting = [campaign for campaign, tasks in self._waiting.items() if tasks]
        if len(waiting) < 2:
            return waiting[0] if waiting else None
        held = Counter(campaign for campaign, _ in self._holder)
        return min(waiting, key=lambda campaign: (held[campaign], campaign))

    def _take(self, campaign: int, worker: bytes, target: int) -> tuple[EpisodeTask, ...]:
        seat, waiting = self.seats[worker], self._waiting[campaign]
        campaigns = sum(bool(tasks) for tasks in self._waiting.values())
        room = ceil((min(target, seat.credit) - len(seat.held)) / campaigns)
        share = ceil(len(waiting) / (2 * len(self.seats)))
        n = max(1, min(room, share))
        tasks = tuple(waiting.popitem(last=False)[1] for _ in range(n))
        for task in tasks:
            self._lend(worker, (campaign, task.index), task)
        return tasks

    def _lend(self, worker: bytes, key: Key, task: EpisodeTask) -> None:
        self.seats[worker].lend(key, task)
        self._holder[key] = worker
