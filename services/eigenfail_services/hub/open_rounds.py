"""The open rounds of a campaign: their episodes, results and policies."""

from collections import Counter
from collections.abc import Callable, Iterable

import msgspec
import numpy as np

from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.episode import EpisodeResult, EpisodeTask
from eigenfail.values.learning import Policy, Round
from eigenfail.values.records import Verdict
from eigenfail_services.hub.leases import Leases
from eigenfail_services.store.codec import NoiseForm
from eigenfail_services.store.judging import make_storable
from eigenfail_services.store.store import Store

MAX_REFUSALS = 3


class RoundCollector:
    """Collects results until the oldest round is complete, and returns them in index order."""

    def __init__(self) -> None:
        self._rounds: dict[int, Round] = {}
        self._tasks: dict[int, EpisodeTask] = {}
        self._results: dict[int, EpisodeResult] = {}
        # Counted, since the oldest round is asked for at each turn of the hub.
        self._missing: dict[int, int] = {}
        self._round_of: dict[int, int] = {}

    def list_new_tasks(self, rounds: Iterable[Round]) -> tuple[EpisodeTask, ...]:
        """Return the tasks of the rounds that are not open yet."""
        return tuple(task for r in rounds if r.number not in self._rounds for task in r.tasks)

    def open(self, rounds: Iterable[Round]) -> tuple[EpisodeTask, ...]:
        """Open the rounds that are not open yet, and return their tasks."""
        fresh = [r for r in rounds if r.number not in self._rounds]
        for r in fresh:
            self._rounds[r.number] = r
            self._missing[r.number] = len(r.tasks)
            self._tasks.update((task.index, task) for task in r.tasks)
            self._round_of.update((task.index, r.number) for task in r.tasks)
        return tuple(task for r in fresh for task in r.tasks)

    def find_pending_task(self, index: int) -> EpisodeTask | None:
        """Return the task of an episode in an open round; None if it has a result already."""
        return None if index in self._results else self._tasks.get(index)

    def count_pending(self) -> int:
        """Return the number of results that open rounds still need."""
        return sum(self._missing.values())

    def add(self, result: EpisodeResult) -> None:
        """Add a result; one that no open round needs is ignored."""
        number = self._round_of.get(result.index)
        if number is None:
            return
        if result.index not in self._results:
            self._missing[number] -= 1
        self._results[result.index] = result

    def pop_complete(self) -> tuple[EpisodeResult, ...] | None:
        """Close the oldest round and return its results, if it is complete."""
        if not self._rounds:
            return None
        # Rounds are observed in order, whichever is complete first.
        number = min(self._rounds)
        if self._missing[number]:
            return None
        indices = [task.index for task in self._rounds.pop(number).tasks]
        del self._missing[number]
        for index in indices:
            del self._tasks[index], self._round_of[index]
        return tuple(self._results.pop(index) for index in indices)

    def find_policy(self, version: int) -> Policy:
        """Return a policy of an open round.

        Raises:
            KeyError: no open round has it.
        """
        for opened in self._rounds.values():
            if opened.policy is not None and opened.policy.version == version:
                return opened.policy
        raise KeyError(version)


class OpenRounds:
    """Has the episodes of rounds run; the learner observes the results that the store keeps.

    Args:
        campaign: id of the campaign.
        form: form of its noise.
        store: store of the results.
        leases: leases of all campaigns.
        observes: whether the learner uses the results; if not, it gets their outcomes alone.

    Attributes:
        collector: the rounds, with the results so far.
        problem: why the rounds cannot become complete; empty while they can.
    """

    def __init__(
        self,
        campaign: int,
        form: NoiseForm,
        store: Store,
        leases: Leases,
        *,
        observes: bool = True,
    ) -> None:
        self.problem = ""
        self._campaign = campaign
        self._form = form
        nothing = np.zeros((0, form.channels), np.float32)
        self._no_noise = NoiseTrajectory(nothing, nothing)
        self._store = store
        self._leases = leases
        self._observes = observes
        self.collector = RoundCollector()
        self._to_look_up: set[int] = set()
        self._refusals = Counter[int]()
        self._handlers: dict[Verdict, Callable[[EpisodeResult], None]] = {
            Verdict.KEPT: self._add,
            Verdict.DUPLICATE: self._look_up,
            Verdict.ALARM: self._look_up,
            Verdict.UNWANTED: self._offer_again,
        }

    def open(self, rounds: Iterable[Round]) -> None:
        """Offer the episodes of new rounds to workers, except those that have a result.

        Raises:
            StoreUnavailable: no new round is open.
        """
        rounds = tuple(rounds)
        indices = [task.index for task in self.collector.list_new_tasks(rounds)]
        finished = self._store.episodes.finished(self._campaign, indices)
        # Only after the last call of the store, which may fail: a round is opened once.
        tasks = self.collector.open(rounds)
        known = {result.index for result in finished}
        self._leases.offer(self._campaign, tuple(task for task in tasks if task.index not in known))
        for result in finished:
            self.collector.add(self._reduce(result))

    def take_verdict(self, result: EpisodeResult, verdict: Verdict) -> None:
        """Add, look up or request again a result, by the store's verdict on it."""
        self._handlers[verdict](result)

    def load_kept_results(self) -> int:
        """Load the kept results of episodes that had a second one; return how many there were.

        Raises:
            StoreUnavailable: the next call tries again.
        """
        if not self._to_look_up:
            return 0
        kept = self._store.episodes.finished(self._campaign, self._to_look_up)
        for result in kept:
            self._add(result)
        # Last, so that the next call asks again if the store is away.
        self._to_look_up.clear()
        return len(kept)

    def _add(self, result: EpisodeResult) -> None:
        # The episode may have been proposed after its result came and before that was committed.
        if self._leases.needs_result(self._campaign, result.index):
            self._leases.complete(self._campaign, result.index, wall_s=0.0)
        self.collector.add(self._reduce(result))

    def _reduce(self, result: EpisodeResult) -> EpisodeResult:
        """Return the part of a result that the learner is to observe."""
        if not self._observes:
            identity = result.index, result.seed, result.outcome, result.steps
            return EpisodeResult(*identity, self._no_noise, result.source)
        # It must see the same numbers as one that starts again and reads from the store.
        kept = make_storable(result, self._form)
        return kept if kept.scene is None else msgspec.structs.replace(kept, scene=None)

    def _look_up(self, result: EpisodeResult) -> None:
        """Look up the first result of an episode: it may have come to another hub."""
        if self.collector.find_pending_task(result.index) is not None:
            self._to_look_up.add(result.index)

    def _offer_again(self, result: EpisodeResult) -> None:
        """Offer the episode of a refused result again, up to `MAX_REFUSALS` times."""
        task = self.collector.find_pending_task(result.index)
        if task is None:
            return
        self._refusals[result.index] += 1
        if self._refusals[result.index] < MAX_REFUSALS:
            self._leases.offer(self._campaign, (task,))
            return
        self.problem = (
            f"The result of episode {result.index} was refused {MAX_REFUSALS} times: its seed, "
            "steps or shapes are not those of this campaign. Install the same eigenfail, and the "
            "same plug-ins, on all workers."
        )
