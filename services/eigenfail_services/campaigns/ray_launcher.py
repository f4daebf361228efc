"""Workers on Ray: as many as the work needs, on a Ray that is started again when it is lost."""

import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress

import msgspec
import structlog

from eigenfail.errors import ClusterUnavailable
from eigenfail.hosting.service import Span
from eigenfail.wire.keys import WorkerKey
from eigenfail_services.campaigns import launcher, ray_link

UNPLACED_AFTER_S = 5.0
"""Time after which a worker without a place is reported: with room it is placed sooner. [s]"""


ASKED, REFUSED, MACHINES = "workers.asked", "workers.refused", "ray.machines"


class PlacementNotices:
    """Turns changes of the cluster's status into notices."""

    def __init__(self) -> None:
        self._unplaced_since_s: float | None = None
        self._said = ""
        self._before = ray_link.ClusterStatus()

    def note(self, now_s: float, standing: ray_link.ClusterStatus) -> list[launcher.Notice]:
        """Return the notices of a new status.

        Args:
            now_s: time of a monotonic clock. [s]
            standing: status that the Ray process reported.
        """
        before, self._before = self._before, standing
        return [
            *self._places(now_s, standing),
            *_list_refusals(standing, before),
            *_list_losses(standing, before),
        ]

    def _places(self, now_s: float, standing: ray_link.ClusterStatus) -> list[launcher.Notice]:
        """Report only lasting states and their end: every worker lacks a place for a moment."""
        if not standing.unplaced:
            self._unplaced_since_s = None
        elif self._unplaced_since_s is None:
            self._unplaced_since_s = now_s
        since_s = self._unplaced_since_s
        lasts = since_s is not None and now_s - since_s >= UNPLACED_AFTER_S
        message = _describe_asked(standing)
        if message == self._said or not (lasts or self._said):
            return []
        self._said = message if lasts else ""
        return [launcher.Notice(ASKED, message)]


def _describe_asked(standing: ray_link.ClusterStatus) -> str:
    placed, n = len(standing.placed), len(standing.placed) + len(standing.unplaced)
    workers = f"{n} worker{'' if n == 1 else 's'} asked of Ray"
    if placed == n:
        return f"{workers}, all placed."
    return f"{workers}, {f'{placed} placed so far' if placed else 'none placed yet'}."


def _list_refusals(
    standing: ray_link.ClusterStatus, before: ray_link.ClusterStatus
) -> list[launcher.Notice]:
    new = {name: why for name, why in standing.refused.items() if name not in before.refused}
    return [launcher.Notice(REFUSED, f"Worker {name} gave up: {why}") for name, why in new.items()]


def _list_losses(
    standing: ray_link.ClusterStatus, before: ray_link.ClusterStatus
) -> list[launcher.Notice]:
    if standing.machines >= before.machines:
        return []
    left = f"{before.machines} machines before, {standing.machines} now"
    return [launcher.Notice(MACHINES, f"Ray's cluster has become smaller: {left}.")]


LOST, BACK = "ray.lost", "ray.back"


FIRST_PAUSE_S, LONGEST_PAUSE_S = 1.0, 30.0
"""Pauses between attempts: twice as long each time, until a Ray has lasted that long. [s]"""


LOOK_EVERY_S = 0.05


log = structlog.get_logger()


class RayLauncher:
    """Workers as Ray actors, on a cluster or on a Ray of one machine that it starts.

    Args:
        span: minimum and maximum number of workers; equal bounds fix the number.
        cluster: address of a running Ray; None starts a Ray on this machine that ends with the
            launcher.
        clock: monotonic time. [s]
    """

    def __init__(
        self, span: Span, cluster: str | None = None, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._span = span
        self._cluster = cluster
        self._clock = clock
        self._roll = launcher.WorkerNames(span)
        self._placement = PlacementNotices()
        self._standing: ray_link.ClusterStatus | None = None
        self._link: ray_link.RayLink | None = None
        self._notices: deque[launcher.Notice] = deque()
        self._again_s, self._since_s, self._pause_s = 0.0, 0.0, FIRST_PAUSE_S
        self._was_lost = self._said_none = False

    def start(
        self, hub: str, key: WorkerKey | None = None, given_up: Callable[[], bool] = launcher.never
    ) -> None:
        """Connect to Ray, and request the minimum number of workers.

        Raises:
            ClusterUnavailable: Ray is not installed, or does not start.
        """
        self._begin = ray_link.StartRay(
            hub, key.text() if key else None, self._cluster, self._span.most
        )
        self._link = link = first_link(self._begin)
        link.want((*self._roll.names,))
        # The start waits for the first report: without Ray the service must refuse to start, and
        # not log an event.
        while self._standing is None:
            if given_up():
                link.kill()  # who still waits for Ray does not hear that it is to end
                self._link = None
                return
            if lost := self._heard(link):
                raise ClusterUnavailable(lost.problem, lost.remedy)
            time.sleep(LOOK_EVERY_S)

    def poll(self, table: launcher.WorkerPool) -> Sequence[launcher.Notice]:
        """Read the state of Ray, restart it if it is lost, and request the needed workers."""
        if (link := self._link) is None:
            self._try_again()
        elif lost := self._heard(link):
            self._lose(link, lost)
        self._staff(table)
        notices = (*self._notices,)
        self._notices.clear()
        return notices

    def stop(self) -> None:
        """Wait a moment for the workers to leave by themselves, then let go of Ray."""
        if self._link is not None:
            self._link.stop()
            self._link = None

    def _heard(self, link: ray_link.RayLink) -> ray_link.ClusterLost | None:
        """Process the reports of the Ray process; return the report that Ray is lost, if any."""
        with suppress(msgspec.DecodeError):
            for word in link.hear():
                if isinstance(word, ray_link.ClusterLost):
                    return word
                self._stands(word)
        problem = link.trouble()
        return (
            ray_link.ClusterLost(problem, "The log of the services has its last words.")
            if problem
            else None
        )

    def _stands(self, standing: ray_link.ClusterStatus) -> None:
        if self._standing is None:
            self._since_s = self._clock()
        self._standing = standing
        self._notices += self._placement.note(self._clock(), standing)
        if self._was_lost:
            self._was_lost = False
            self._say(BACK, f"Ray is back (machines: {standing.machines}).")

    def _lose(self, link: ray_link.RayLink, lost: ray_link.ClusterLost) -> None:
        link.kill()
        if self._standing and self._clock() - self._since_s >= LONGEST_PAUSE_S:
            self._pause_s = FIRST_PAUSE_S
        self._link, self._standing, self._placement = None, None, PlacementNotices()
        # An outage is one event, however many attempts its end takes.
        if not self._was_lost:
            what = "The services reconnect to it." if self._cluster else "Another is started."
            self._say(LOST, f"Ray is lost. {lost.problem} {what} What its workers ran runs again.")
        self._was_lost = True
        self._again_s = self._clock() + self._pause_s
        log.warning("ray lost", problem=lost.problem, again_in_s=self._pause_s)
        self._pause_s = min(2.0 * self._pause_s, LONGEST_PAUSE_S)

    def _try_again(self) -> None:
        if self._clock() < self._again_s:
            return
        try:
            self._link = ray_link.RayLink(self._begin)
        except OSError as error:
            log.warning("ray process not started", problem=str(error))
            self._again_s = self._clock() + self._pause_s

    def _staff(self, table: launcher.WorkerPool) -> None:
        demand = table.measure_demand()
        self._roll.look(self._clock(), demand)
        if self._span.most == 0 and demand.work.episodes and not self._said_none:
            self._said_none = True
            self._say(ASKED, launcher.NONE_MAY_START)
        if self._standing is not None:
            # Only workers that this launcher placed are sent home: others belong to the users who
            # started them.
            placed = {*self._standing.placed, *self._standing.unplaced}
            table.drain_workers(placed.difference(self._roll.names))
        if self._link is not None:
            self._link.want((*self._roll.names,))

    def _say(self, kind: str, message: str) -> None:
        self._notices.append(launcher.Notice(kind, message))


def first_link(begin: ray_link.StartRay) -> ray_link.RayLink:
    """Start the Ray process of a service, and return its link.

    Raises:
        ClusterUnavailable: the system lacks the resources for it.
    """
    try:
        return ray_link.RayLink(begin)
    except OSError as error:
        raise ClusterUnavailable(
            f"The process of Ray's driver cannot be started: {error.strerror}.",
            "Free memory, or raise the limits of processes and open files (`ulimit -u -n`); or "
            "start workers without Ray: `--launcher local`.",
        ) from error
