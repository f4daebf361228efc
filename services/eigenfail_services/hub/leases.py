"""Who runs which episode: a state machine without a socket. Events in, assignments out."""

from collections import Counter, OrderedDict
from math import ceil, inf

import msgspec

from eigenfail.values import EpisodeTask

WORK_AHEAD_S = 2.0
"""How much work a worker should hold, so that it never waits for the hub."""

UNKNOWN_PACE_S = 0.1
PACE_SMOOTHING = 0.2
MAX_LOSSES = 3
IDLE_BEATS = 10
"""Who says so often in a row that they run nothing has never got what they were given."""

Key = tuple[int, int]
"""Campaign and index of an episode."""


class Assignment(msgspec.Struct, frozen=True, eq=False):
    """These episodes go to this worker."""

    worker: bytes
    campaign: int
    tasks: tuple[EpisodeTask, ...]


class Seat:
    """A worker at the table."""

    def __init__(self, name: str, credit: int, now_s: float) -> None:
        self.name = name
        self.credit = credit
        self.heard_s = now_s
        self.running: Key | None = None
        self.idle_beats = 0
        self.held: dict[Key, EpisodeTask] = {}

    def is_hungry(self, target: int) -> bool:
        """Whether it holds no more than half of what it should, or may."""
        return len(self.held) <= min(target, self.credit) // 2 and self.credit > 0


class Leases:
    """Hands episodes to workers in batches, and takes them back from workers that are lost."""

    def __init__(self) -> None:
        self.seats: dict[bytes, Seat] = {}
        self._holder: dict[Key, bytes] = {}
        self._waiting: dict[int, OrderedDict[int, EpisodeTask]] = {}
        self._pace_s: dict[int, float] = {}
        self._losses: dict[Key, int] = {}

    def join(self, worker: bytes, name: str, credit: int, now_s: float) -> None:
        """A worker sits down; what it held under this connection before is free again."""
        self.leave(worker)
        self.seats[worker] = Seat(name, credit, now_s)

    def heard(self, worker: bytes, now_s: float) -> Seat | None:
        """A worker was heard; None if it has no seat."""
        if seat := self.seats.get(worker):
            seat.heard_s = now_s
        return seat

    def running(self, worker: bytes, campaign: int | None, index: int | None) -> None:
        """A worker says which episode it is running, if any: the one to blame if it is lost.

        What it holds and does not run, for long, is free again: a lease or a result went astray.
        """
        seat = self.seats[worker]
        seat.running = None if campaign is None or index is None else (campaign, index)
        seat.idle_beats = 0 if seat.running else seat.idle_beats + 1
        if seat.idle_beats >= IDLE_BEATS:
            self._free(seat)

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

    def leave(self, worker: bytes) -> list[tuple[int, EpisodeTask]]:
        """A worker is gone: what it held waits again, at the front.

        Returns:
            The episodes that have now been running in three lost workers, with their campaigns;
            they are not handed out again.
        """
        seat = self.seats.pop(worker, None)
        if seat is None:
            return []
        given_up = self._blame(seat)
        self._free(seat)
        return given_up

    def _free(self, seat: Seat) -> None:
        while seat.held:
            key, task = seat.held.popitem()
            del self._holder[key]
            self._waiting[key[0]][task.index] = task
            self._waiting[key[0]].move_to_end(task.index, last=False)

    def _blame(self, seat: Seat) -> list[tuple[int, EpisodeTask]]:
        key = seat.running
        if key is None or key not in seat.held:
            return []
        self._losses[key] = self._losses.get(key, 0) + 1
        if self._losses[key] < MAX_LOSSES:
            return []
        del self._holder[key]
        return [(key[0], seat.held.pop(key))]

    def offer(self, campaign: int, tasks: tuple[EpisodeTask, ...]) -> None:
        """These episodes are to be run."""
        waiting = self._waiting.setdefault(campaign, OrderedDict())
        waiting.update((task.index, task) for task in tasks)

    def withdraw(self, campaign: int) -> None:
        """Nothing of this campaign is to be run any more."""
        self._waiting.pop(campaign, None)
        self._pace_s.pop(campaign, None)
        self._losses = {key: n for key, n in self._losses.items() if key[0] != campaign}
        for key in [key for key in self._holder if key[0] == campaign]:
            del self.seats[self._holder.pop(key)].held[key]

    def settle(self, campaign: int, index: int, wall_s: float) -> None:
        """The episode has a result, from whomever it came."""
        if (holder := self._holder.pop((campaign, index), None)) is not None:
            del self.seats[holder].held[campaign, index]
        elif campaign in self._waiting:
            self._waiting[campaign].pop(index, None)
        if campaign in self._waiting and 0.0 < wall_s < inf:  # it came over the wire
            pace_s = self._pace_s.get(campaign, wall_s)
            self._pace_s[campaign] = pace_s + PACE_SMOOTHING * (wall_s - pace_s)

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
        target = self._target(campaign)
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

    def _target(self, campaign: int) -> int:
        pace_s = max(self._pace_s.get(campaign, UNKNOWN_PACE_S), 1e-4)
        return max(2, round(WORK_AHEAD_S / pace_s))

    def _take(self, campaign: int, worker: bytes, target: int) -> tuple[EpisodeTask, ...]:
        seat, waiting = self.seats[worker], self._waiting[campaign]
        seat.idle_beats = 0
        campaigns = sum(bool(tasks) for tasks in self._waiting.values())
        room = ceil((min(target, seat.credit) - len(seat.held)) / campaigns)
        share = ceil(len(waiting) / (2 * len(self.seats)))
        n = max(1, min(room, share))
        tasks = tuple(waiting.popitem(last=False)[1] for _ in range(n))
        for task in tasks:
            seat.held[campaign, task.index] = task
            self._holder[campaign, task.index] = worker
        return tasks
