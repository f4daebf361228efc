"""Waiting for something that the service works on."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from time import monotonic, sleep
from typing import TypeVar

from eigenfail.errors import ServiceError
from eigenfail.values import Campaign

Kind = TypeVar("Kind")
Tell = Callable[[Campaign], None]


class Patience:
    """How long blocking calls wait: as long as it takes."""

    def rest(self, seconds: float) -> None:
        """Let time pass between two looks."""
        sleep(seconds)

    def cutting(self, cut: Callable[[], None]) -> AbstractContextManager[None]:  # noqa: ARG002
        """Within the block, `cut` ends a read that blocks; called if nobody waits any more."""
        return nullcontext()


patience: ContextVar[Patience] = ContextVar("patience", default=Patience())  # noqa: B039 - no state
"""Of the calls in this context; the asynchronous client has another."""


def wait_until(
    look: Callable[[], Kind],
    is_over: Callable[[Kind], bool],
    poll_s: float,
    timeout_s: float | None,
) -> Kind:
    """The first look at which it is over.

    Raises:
        ServiceError: it is not over in time; it goes on all the same.
    """
    latest = None if timeout_s is None else monotonic() + timeout_s
    while not is_over(seen := look()):
        if latest is not None and monotonic() >= latest:
            raise ServiceError(
                f"It is not over after {timeout_s:g} s, and goes on.",
                "Wait longer, or look at the service's log if nothing moves.",
            )
        patience.get().rest(poll_s)
    return seen


@contextmanager
def telling(on_progress: Tell | None, progress: bool) -> Iterator[Tell]:
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
