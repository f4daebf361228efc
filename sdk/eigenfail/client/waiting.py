"""Waiting for something that the service works on."""

from collections.abc import Callable
from time import monotonic, sleep
from typing import TypeVar

from eigenfail.errors import ServiceError

Kind = TypeVar("Kind")


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
        sleep(poll_s)
    return seen
