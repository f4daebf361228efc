"""Episodes that were in a bridge when it was lost: they begin anew, but not for ever."""

from collections import deque
from collections.abc import Iterable

from eigenfail.errors import BridgeLost
from eigenfail.values import EpisodeResult, EpisodeTask
from eigenfail_workers.bridge.drive import Drive

MOST_LOSSES = 3


class Again:
    """Counts the losses of each episode. Who is suspect runs alone: then it is known who it was."""

    def __init__(self) -> None:
        self._losses: dict[int, int] = {}
        self._waiting: deque[EpisodeTask] = deque()

    def __len__(self) -> int:
        """How many wait to begin anew."""
        return len(self._waiting)

    def lost(self, drives: list[Drive], error: BridgeLost) -> list[EpisodeResult]:
        """Have them begin anew; what is left of those that have had all their tries."""
        left = []
        for drive in drives:
            index = drive.task.index
            self._losses[index] = self._losses.get(index, 0) + 1
            if self._losses[index] < MOST_LOSSES:
                self._waiting.append(drive.task)
            else:
                left.append(drive.fail(blaming(error), len(drives)))
        self._waiting = deque(sorted(self._waiting, key=self.is_suspect))
        return left

    def is_suspect(self, task: EpisodeTask) -> bool:
        """Whether one more loss would be its last."""
        return self._losses.get(task.index, 0) == MOST_LOSSES - 1

    def next(self, beside: int) -> EpisodeTask | None:
        """Who is to begin beside so many others; none if those have to end first."""
        if not self._waiting or (beside and self.is_suspect(self._waiting[0])):
            return None
        return self._waiting.popleft()

    def give_up(self) -> list[EpisodeTask]:
        """All that wait."""
        left = list(self._waiting)
        self._waiting.clear()
        return left

    def forget(self, results: Iterable[EpisodeResult]) -> None:
        """These are over."""
        for result in results:
            self._losses.pop(result.index, None)


def blaming(error: BridgeLost) -> BridgeLost:
    """The last loss of an episode that ran alone."""
    said = f"It was loss no. {MOST_LOSSES} while this episode ran, the last time alone."
    return BridgeLost(f"{error.problem} {said}", error.remedy)
