"""Who runs which episode: a state machine without a socket. Events in, assignments out."""

from collections.abc import Collection

from eigenfail.values import EpisodeTask
from eigenfail.wire.claims import same_task
from eigenfail.wire.messages import Hello
from eigenfail_services.hub.claims import Claims, Fingerprint, Key
from eigenfail_services.hub.dealer import Assignment, Dealer, Portion
from eigenfail_services.hub.loans import Loans
from eigenfail_services.hub.seating import Seating
from eigenfail_services.hub.seats import Seat
from eigenfail_services.hub.suspects import Missed, Suspects
from eigenfail_services.hub.waiting import Waiting


class Leases:
    """Hands episodes to workers in batches, and takes them back from workers that are gone.

    Attributes:
        seats: who is here, by their connections.
    """

    def __init__(self) -> None:
        self._seating = Seating()
        self.seats = self._seating.seats
        self._dealer = Dealer()
        self._loans = Loans(self.seats, self._dealer)
        self._waiting = Waiting()
        self._claims = Claims()
        self._suspects = Suspects()
        self._brought: set[Key] = set()

    def join(self, worker: bytes, hello: Hello, now_s: float) -> None:
        """A worker sits down, with what it says that it holds.

        If it had a seat before, by this connection or another one, it begins anew: all else that
        it held there is free again.
        """
        for old in self._seating.of(worker, hello):
            self.leave(old)
        if missed := self._suspects.is_back(hello.life):
            self._put_back(missed.key[0], missed.task)
        self._seating.sit(worker, hello, now_s)
        self._claims.take(worker, hello.claims)
        self._dealer.look(worker, self.seats[worker])

    def heard(self, worker: bytes, now_s: float) -> Seat | None:
        """A worker was heard; None if it has no seat."""
        return self._seating.heard(worker, now_s)

    def beat(
        self, worker: bytes, running: Key | None, named: Collection[Key], slots: int = 1
    ) -> None:
        """A worker says which episode it is running, if any, and names all that it holds.

        The first is the one to suspect if the worker is lost. What it does not name for long is
        free again: a lease or a result went astray.
        Of the campaign that it runs, it can run so many side by side as it has `slots`.
        """
        seat = self.seats[worker]
        if seat.runs(running, slots):
            self._dealer.look(worker, seat)
        claimed = self._claims.of(worker)
        missed = seat.missed(seat.held.keys() | claimed, named)
        for key in missed & claimed:
            self._claims.discard(worker, key)
        self._free(seat, missed)

    def busy(self, campaign: int) -> bool:
        """Whether any episode of a campaign is with a worker."""
        return self._loans.busy(campaign)

    def expects(self, campaign: int) -> bool:
        """Whether more results of a campaign are to come: some episode is out, or waits to go."""
        return self.busy(campaign) or campaign in self._waiting.campaigns()

    def pace_s(self, campaign: int) -> float:
        """What an episode of a campaign is thought to take of a worker. [s]"""
        return self._dealer.pace_s(campaign)

    def retire(self, worker: bytes) -> None:
        """A worker gets nothing more."""
        seat = self.seats[worker]
        seat.credit = 0
        self._dealer.look(worker, seat)

    def silent(self, now_s: float, limit_s: float) -> list[bytes]:
        """The workers that were not heard for longer than the limit."""
        return self._seating.silent(now_s, limit_s)

    def excuse(self, away_s: float, now_s: float) -> None:
        """Nobody could be heard for a while: that is not the workers' silence."""
        self._seating.excuse(away_s, now_s)
        self._suspects.excuse(away_s)

    def leave(self, worker: bytes) -> None:
        """A worker goes, or begins anew: it lives, and has died of nothing that it ran.

        What it held waits again, at the front.
        """
        self._claims.leave(worker)
        if seat := self.seats.get(worker):
            self._free(seat, set(seat.held))
            self._seating.leave(worker)
            self._dealer.leave(worker, seat)

    def lose(self, worker: bytes) -> None:
        """A worker is gone without a word: what it ran is suspected, the rest waits again."""
        seat = self.seats[worker]
        if seat.running is not None and seat.running in seat.held:
            self._suspects.add(seat.running, self._loans.end(seat.running).task)
        self.leave(worker)

    def miss(self, worker: bytes, until_s: float) -> None:
        """Its line is closed: all that it held waits. What it ran is suspected if it stays away."""
        seat = self.seats[worker]
        if seat.running is not None and (task := seat.held.get(seat.running)) is not None:
            self._suspects.miss(seat.life or worker.hex(), Missed(seat.running, task, until_s))
        self.leave(worker)

    def suspect(self, now_s: float) -> None:
        """Those who are missed, and not back in time, were lost with what they ran."""
        for key, task, _ in self._suspects.overdue(now_s):
            if self._waiting.wants(*key):
                self._suspects.add(key, task)

    def suspects(self) -> list[tuple[int, EpisodeTask]]:
        """Campaigns and episodes that ran as their workers were lost, and are to be counted."""
        return [*self._suspects]

    def acquit(self, campaign: int, index: int) -> None:
        """An episode that was suspected waits again, at the front, unless somebody has it."""
        if task := self._suspects.pop((campaign, index)):
            self._put_back(campaign, task)

    def _free(self, seat: Seat, keys: Collection[Key]) -> None:
        for key in reversed([key for key in seat.held if key in keys]):
            self._put_back(key[0], self._loans.undo(key))

    def _put_back(self, campaign: int, task: EpisodeTask) -> None:
        key = campaign, task.index
        is_free = self._loans.held(key) is None and not self._suspects.withholds(key, task)
        if is_free and task.index not in self._waiting.of(campaign):
            self._waiting.put_back(campaign, task)
            self._claims.look_again(campaign)

    def offer(self, campaign: int, tasks: tuple[EpisodeTask, ...]) -> None:
        """These episodes are to be run, unless somebody is at it or has just brought them."""
        self._waiting.want(campaign, tasks)
        self._claims.look_again(campaign)
        for task in tasks:
            if not self._is_out(campaign, task):
                self._waiting.add(campaign, task)

    def _is_out(self, campaign: int, task: EpisodeTask) -> bool:
        key = campaign, task.index
        if key in self._brought or self._suspects.withholds(key, task):
            return True
        held = self._loans.held(key)
        if held is None or same_task(held, task):
            return held is not None
        self._loans.end(key)
        return False

    def weigh(self, campaign: int, weight: float) -> None:
        """From now on its share of the workers' time goes by this weight."""
        self._dealer.weigh(campaign, weight)

    def need_bridge(self, campaign: int) -> None:
        """Only workers with a bridge get anything of it."""
        self._dealer.need_bridge(campaign)

    def stranded(self) -> Collection[int]:
        """Campaigns of which something waits that nobody who is here can run."""
        return self._dealer.stranded(self._waiting.campaigns())

    def has_bridge(self) -> bool:
        """Whether anybody who is here has one."""
        return self._dealer.has_bridge()

    def suspend(self, campaign: int) -> None:
        """Its learner is lost. What is leased stays so: the next one proposes the same again.

        It goes on from a checkpoint that was committed before any of this was leased, and in
        which the open rounds lie with their indices, seeds and policy versions.
        """
        self._waiting.call_off(campaign)

    def withdraw(self, campaign: int) -> None:
        """Nothing of this campaign is to be run any more."""
        self._waiting.call_off(campaign)
        self._claims.withdraw(campaign)
        self._suspects.withdraw(campaign)
        self._loans.end_all(campaign)
        self._dealer.forget(campaign)

    def bring(self, campaign: int, index: int, wall_s: float, by: bytes | None = None) -> None:
        """A result of the episode has come, and waits to be committed."""
        self._brought.add((campaign, index))
        self.settle(campaign, index, wall_s, by)

    def land(self, campaign: int, index: int) -> None:
        """What was brought was judged; if it is not wanted, the episode may be offered again."""
        self._brought.discard((campaign, index))

    def settle(self, campaign: int, index: int, wall_s: float, by: bytes | None = None) -> None:
        """The episode has a result, from whomever it came: None for whoever holds it."""
        key = campaign, index
        self._claims.settle(key)
        self._suspects.pop(key)
        self._waiting.settle(campaign, index)
        loan = self._loans.settle(key, by)
        if self._waiting.knows(campaign):
            self._dealer.took(campaign, wall_s, loan)

    def adopt(self, fingerprint: Fingerprint) -> set[tuple[bytes, int]]:
        """What waits, and a worker says that it holds, is leased to that worker.

        After a restart, a campaign goes on from a checkpoint that was committed before the first
        lease of the rounds in it, so a task that a worker took before is the one that waits here.
        Where it is not, as with a worker of another service, the fingerprints differ.

        Returns:
            Workers, and campaigns of which they hold something else than what is asked for here.
        """
        refused = set()
        for claimed in self._claims.matching(self._waiting, fingerprint):
            if claimed.is_right:
                self._loans.lend(claimed.worker, claimed.key, self._waiting.take(*claimed.key))
            else:
                refused.add((claimed.worker, claimed.key[0]))
        return refused

    def assign(self) -> list[Assignment]:
        """Hand out what waits: to the workers with least work, from whose campaign's turn it is."""
        assignments = []
        while (portion := self._dealer.next(self.seats, self._waiting)) is not None:
            assignments.append(self._hand_out(portion))
        return assignments

    def _hand_out(self, portion: Portion) -> Assignment:
        worker, campaign, episodes = portion
        tasks = tuple(self._waiting.take(campaign) for _ in range(episodes))
        for task in tasks:
            self._loans.lend(worker, (campaign, task.index), task)
        return Assignment(worker, campaign, tasks)
