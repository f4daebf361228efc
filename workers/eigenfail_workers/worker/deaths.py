"""What a worker remembers of the inner processes that it lost, and whom it blames."""

from eigenfail.errors import ServiceError
from eigenfail_workers.worker.child_process import Held

MAX_CHILD_DEATHS = 3
MAX_FALSE_STARTS = 20
"""Lives of the child, one after the other, that brought no result at all."""

MAX_STILLBORN = 10
"""Lives, one after the other, that ended before they could have taken an episode."""


class Deaths:
    """Counts, for each episode, the processes that it ended; and the lives that were in vain."""

    def __init__(self) -> None:
        self._of: dict[tuple[int, int], int] = {}
        self._false_starts = 0
        self._stillborn = 0

    def brought(self, campaign: int, index: int) -> None:
        """A result has come: the process works, and its episode is nobody's trouble any more."""
        self._of.pop((campaign, index), None)
        self._false_starts = 0

    def lost(self, *, ready: bool, status: int) -> None:
        """A process has ended, after or before it could take episodes.

        Raises:
            ServiceError: too many in a row ended before: no episode is to blame, nor will any run.
        """
        self._false_starts += 1
        self._stillborn = 0 if ready else self._stillborn + 1
        if self._stillborn == MAX_STILLBORN:
            raise ServiceError(
                f"No inner process can start here: {MAX_STILLBORN} ended, one after the other, "
                f"before they could take an episode (the last with exit status {status}).",
                "See what they printed; `python -m eigenfail_workers.worker.child` starts one.",
            )

    def spent(self, held: Held, weight: int) -> bool:
        """Whether an episode has had all its tries, now that a process has ended while it ran.

        Args:
            held: the episode.
            weight: deaths to be counted against it; 0 if it had not begun.
        """
        if self._false_starts > MAX_FALSE_STARTS:
            weight = MAX_CHILD_DEATHS
        key = (held.campaign, held.task.index)
        self._of[key] = self._of.get(key, 0) + weight
        if self._of[key] < MAX_CHILD_DEATHS:
            return False
        del self._of[key]
        return True
