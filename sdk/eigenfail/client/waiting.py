"""Waiting for something that the service works on."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from itertools import count
from logging import getLogger
from math import inf
from time import monotonic, sleep
from typing import TypeVar

from eigenfail.errors import ServiceBusy, ServiceError, ServiceUnreachable, StoreUnavailable
from eigenfail.values import Campaign

AWAY_S = 60.0
AWAY = (ServiceUnreachable, StoreUnavailable, ServiceBusy)

Kind = TypeVar("Kind")
Tell = Callable[[Campaign], None]

log = getLogger("eigenfail.client")


class Waiter:
    """How long blocking calls wait: as long as it takes."""

    def rest(self, seconds: float) -> None:
        """Let time pass between two looks."""
        sleep(seconds)

    def cutting(self, cut: Callable[[], None]) -> AbstractContextManager[None]:  # noqa: ARG002
        """Within the block, `cut` ends a read that blocks; called if nobody waits any more."""
        return nullcontext()


class CheckingWaiter(Waiter):
    """Looks after something while it waits.

    Args:
        check: raises if it is in trouble.
    """

    def __init__(self, check: Callable[[], None]) -> None:
        self._check = check

    def rest(self, seconds: float) -> None:
        """Let time pass, unless there is trouble."""
        self._check()
        super().rest(seconds)


waiter: ContextVar[Waiter] = ContextVar("patience", default=Waiter())  # noqa: B039 - no state
"""Of the calls in this context; the asynchronous client has another."""


def wait_until(
    look: Callable[[], Kind],
    is_over: Callable[[Kind], bool],
    poll_s: float,
    timeout_s: float | None,
) -> Kind:
    """The first look at which it is over.

    A service that was there once may be away for a minute, to be started anew.

    Raises:
        ServiceError: it is not over in time; it goes on all the same.
    """
    latest_s = inf if timeout_s is None else monotonic() + timeout_s
    seen = look()
    while not is_over(seen):
        if monotonic() >= latest_s:
            raise ServiceError(
                f"It is not over after {timeout_s:g} s, and goes on.",
                "Wait longer, or look at the service's log if nothing moves.",
            )
        waiter.get().rest(poll_s)
        seen = _look_until_back(look, poll_s, min(latest_s, monotonic() + AWAY_S))
    return seen


def _look_until_back(look: Callable[[], Kind], poll_s: float, until_s: float) -> Kind:
    """What is seen as soon as the service is there; after some time, its absence is raised."""
    for tries in count():
        try:
            return look()
        except AWAY as error:
            if monotonic() >= until_s:
                raise
            if not tries:
                log.warning("%s It was there a moment ago: waiting.", error.problem)
        waiter.get().rest(poll_s)
    raise AssertionError("counting has no end")


@contextmanager
def checking(check: Callable[[], None]) -> Iterator[None]:
    """Within the block, whoever waits looks after something."""
    token = waiter.set(CheckingWaiter(check))
    try:
        yield
    finally:
        waiter.reset(token)


@contextmanager
def report_progress(on_progress: Tell | None, progress: bool) -> Iterator[Tell]:
    """Whoever is to be told of a campaign as it goes: a function, a display, both or nobody."""
    tell = on_progress or (lambda _campaign: None)
    if not progress:
        yield tell
        return
    from eigenfail.progress import reporter

    with reporter() as show:

        def both(campaign: Campaign) -> None:
            show(campaign)
            tell(campaign)

        yield both
