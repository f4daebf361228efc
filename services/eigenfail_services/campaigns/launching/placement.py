"""What is to be said of the workers that Ray was asked for: once, and again when it has changed."""

from eigenfail_services.campaigns.launching.launcher import Notice
from eigenfail_services.campaigns.launching.ray_words import Standing

UNPLACED_AFTER_S = 5.0
"""Where there is room for a worker it has its place sooner."""

ASKED, REFUSED, MACHINES = "workers.asked", "workers.refused", "ray.machines"


class Placement:
    """Compares how things stand with what was said last."""

    def __init__(self) -> None:
        self._unplaced_since_s: float | None = None
        self._said = ""
        self._before = Standing()

    def note(self, now_s: float, standing: Standing) -> list[Notice]:
        """What is new.

        Args:
            now_s: of a clock that only ever grows. [s]
            standing: what the Ray process says.
        """
        before, self._before = self._before, standing
        return [
            *self._places(now_s, standing),
            *refusals(standing, before),
            *losses(standing, before),
        ]

    def _places(self, now_s: float, standing: Standing) -> list[Notice]:
        """Only what lasts is said, and its end: every worker is without a place for a moment."""
        if not standing.unplaced:
            self._unplaced_since_s = None
        elif self._unplaced_since_s is None:
            self._unplaced_since_s = now_s
        since_s = self._unplaced_since_s
        lasts = since_s is not None and now_s - since_s >= UNPLACED_AFTER_S
        message = asked(standing)
        if message == self._said or not (lasts or self._said):
            return []
        self._said = message if lasts else ""
        return [Notice(ASKED, message)]


def asked(standing: Standing) -> str:
    """How many Ray was asked for, and how many of them it has placed."""
    placed, n = len(standing.placed), len(standing.placed) + len(standing.unplaced)
    workers = f"{n} worker{'' if n == 1 else 's'} asked of Ray"
    if placed == n:
        return f"{workers}, all placed."
    return f"{workers}, {f'{placed} placed so far' if placed else 'none placed yet'}."


def refusals(standing: Standing, before: Standing) -> list[Notice]:
    """Workers that gave up, and why."""
    new = {name: why for name, why in standing.refused.items() if name not in before.refused}
    return [Notice(REFUSED, f"Worker {name} gave up: {why}") for name, why in new.items()]


def losses(standing: Standing, before: Standing) -> list[Notice]:
    """That the cluster has become smaller."""
    if standing.machines >= before.machines:
        return []
    left = f"{before.machines} machines before, {standing.machines} now"
    return [Notice(MACHINES, f"Ray's cluster has become smaller: {left}.")]
