"""How many workers to have: a state machine of time and work, without a socket and without Ray."""

from collections.abc import Callable, Collection, Sequence
from math import ceil

from eigenfail.hosting.span import Span
from eigenfail_services.hub.muster import Work

WORK_EACH_S = 2.0
"""More workers than have so much work each would not end it noticeably sooner."""

RISE_AFTER_S = 2.0
"""What is needed for a shorter time is worked off before a further worker has started."""


def needed(work: Work) -> int:
    """How many workers that is work for: one at least for what is quick, one at most an episode."""
    return min(work.episodes, max(1, ceil(work.worker_s / WORK_EACH_S)))


class Spell:
    """For how long something else than what there is has been needed, and the least of a change.

    Args:
        lasts_s: how long until it counts. [s]
        nearest: of two needs the one that is nearer to what there is.
    """

    def __init__(self, lasts_s: float, nearest: Callable[[int, int], int]) -> None:
        self._lasts_s = lasts_s
        self._nearest = nearest
        self._began_s: float | None = None
        self._change = 0

    def over(self) -> None:
        """What there is does."""
        self._began_s = None

    def go_on(self, now_s: float, need: int) -> int | None:
        """It does not; what would, once that has lasted long enough."""
        if self._began_s is None:
            self._began_s, self._change = now_s, need
        self._change = self._nearest(self._change, need)
        return self._change if now_s - self._began_s >= self._lasts_s else None


class Scale:
    """Rises to what was needed for two seconds, and falls to what was enough for `idle_s`.

    Whatever the work does, between a rise and the next fall there are at least `idle_s`, and
    between a fall and the next rise two seconds.

    Attributes:
        wanted: how many to have.
    """

    def __init__(self, span: Span) -> None:
        self._span = span
        self.wanted = span.least
        self._more = Spell(RISE_AFTER_S, min)
        self._fewer = Spell(span.idle_s, max)

    def look(self, now_s: float, need: int) -> int:
        """How many to have, as so many are needed now.

        Args:
            now_s: of a clock that only ever grows. [s]
            need: as `needed` tells it, less those whom nobody here starts or ends.
        """
        within = min(max(need, self._span.least), self._span.most)
        for spell, applies in (
            (self._more, within > self.wanted),
            (self._fewer, within < self.wanted),
        ):
            if not applies:
                spell.over()
            elif (changed := spell.go_on(now_s, within)) is not None:
                self.wanted = changed
                self._more.over()
                self._fewer.over()
                break
        return self.wanted


def to_let_go(
    names: Sequence[str], present: Collection[str], idle: Collection[str], n: int
) -> list[str]:
    """Up to n workers, those that came last first: who is not there yet, then who holds nothing.

    Whoever holds an episode is never among them.
    """
    newest = names[::-1]
    absent = [name for name in newest if name not in present]
    return [*absent, *(name for name in newest if name in idle)][:n]
