"""Work that takes seconds, in a thread of its own: others that ask are answered meanwhile."""

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import ParamSpec, TypeVar

from eigenfail.errors import ServiceBusy

MOST_WAITING = 8

Result = TypeVar("Result")
Arguments = ParamSpec("Arguments")


class Aside:
    """Does one piece of work at a time, and lets a few wait for it.

    Args:
        name: of the thread.
    """

    def __init__(self, name: str) -> None:
        self._pool = ThreadPoolExecutor(1, thread_name_prefix=name)
        self._waiting = 0

    async def do(
        self,
        work: Callable[Arguments, Result],
        *args: Arguments.args,
        **kwargs: Arguments.kwargs,
    ) -> Result:
        """What the work returns, or raises.

        Raises:
            ServiceBusy: too many wait already.
        """
        if self._waiting >= MOST_WAITING:
            raise ServiceBusy("The service is busy with others of this kind.", "Try again soon.")
        self._waiting += 1
        try:
            future = self._pool.submit(work, *args, **kwargs)
            return await asyncio.wrap_future(future)
        finally:
            self._waiting -= 1
