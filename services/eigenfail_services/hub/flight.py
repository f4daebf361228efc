"""The rounds of one campaign that are in the air: pure bookkeeping between learner and workers."""

from collections.abc import Iterable

from eigenfail.values import EpisodeResult, EpisodeTask, Policy, Round


class Flight:
    """Collects results until the oldest round is whole, and gives that one out in index order."""

    def __init__(self) -> None:
        self._rounds: dict[int, Round] = {}
        self._results: dict[int, EpisodeResult] = {}
        self._expected: set[int] = set()

    def new(self, rounds: Iterable[Round]) -> tuple[EpisodeTask, ...]:
        """The tasks of those rounds that have not taken off."""
        return tuple(task for r in rounds if r.number not in self._rounds for task in r.tasks)

    def take_off(self, rounds: Iterable[Round]) -> tuple[EpisodeTask, ...]:
        """Open those rounds that are new; their tasks."""
        rounds = tuple(rounds)
        tasks = self.new(rounds)
        self._rounds = {r.number: r for r in rounds} | self._rounds
        self._expected.update(task.index for task in tasks)
        return tasks

    def awaited(self, index: int) -> EpisodeTask | None:
        """The task of an open round that has no result yet."""
        if index not in self._expected or index in self._results:
            return None
        return next(t for r in self._rounds.values() for t in r.tasks if t.index == index)

    def open(self) -> int:
        """How many results open rounds wait for."""
        return len(self._expected) - len(self._results)

    def land(self, result: EpisodeResult) -> None:
        """Take a result; one that no open round waits for is ignored."""
        if result.index in self._expected:
            self._results[result.index] = result

    def whole(self) -> tuple[EpisodeResult, ...] | None:
        """The results of the oldest round if all are there; it is closed by this."""
        if not self._rounds:
            return None
        number = min(self._rounds)
        indices = [task.index for task in self._rounds[number].tasks]
        if any(index not in self._results for index in indices):
            return None
        del self._rounds[number]
        self._expected.difference_update(indices)
        return tuple(self._results.pop(index) for index in indices)

    def policy(self, version: int) -> Policy:
        """A policy that an open round brought.

        Raises:
            KeyError: none of them did.
        """
        for opened in self._rounds.values():
            if opened.policy is not None and opened.policy.version == version:
                return opened.policy
        raise KeyError(version)
