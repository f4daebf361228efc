"""Limits on concurrent work that takes seconds, so that other requests are answered meanwhile."""

import asyncio
from collections.abc import AsyncIterator, Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import ParamSpec, TypeVar
from weakref import WeakKeyDictionary

from anyio.to_thread import run_sync

from eigenfail.errors import ServiceBusy

MOST_WAITING = 8
MOST_RUNNING = 2
"""Requests of one kind; all routes share the threads, of which there are far more."""

LONGEST_WAIT_S = 20.0
"""Longest wait for work to begin. Browsers and proxies wait longer than this and the work take."""

REMEDY = "Try again soon."

Result = TypeVar("Result")
Arguments = ParamSpec("Arguments")


class SerialExecutor:
    """Runs one function at a time in its own thread, with a short queue.

    Args:
        name: name of the thread.
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
        """Run a function in the pool, and return its result or raise its exception.

        Raises:
            ServiceBusy: the queue is full, or the function did not start in time.
        """
        busy = ServiceBusy("The service is busy with other requests of this kind.", REMEDY)
        if self._waiting >= MOST_WAITING:
            raise busy
        # No lock is needed: this number changes in the event loop alone.
        self._waiting += 1
        future = self._pool.submit(work, *args, **kwargs)
        result = asyncio.wrap_future(future)
        try:
            await asyncio.wait([result], timeout=LONGEST_WAIT_S)
            if future.cancel():  # Only work that has not begun can be cancelled.
                raise busy
            return await result
        finally:
            result.cancel()  # The request has ended.
            self._waiting -= 1


class ConcurrencyLimit:
    """Dependency of routes that take seconds: few run, few wait, further requests are refused.

    Use `Depends(limit, scope="function")`: a client that reads slowly then occupies no place.

    Args:
        kind: plural noun for the answers, for messages.
    """

    def __init__(self, kind: str) -> None:
        self._kind = kind
        self._asked = 0
        self._running: WeakKeyDictionary[asyncio.AbstractEventLoop, asyncio.Semaphore]
        self._running = WeakKeyDictionary()

    async def __call__(self) -> AsyncIterator[None]:
        """Wait for a place, and occupy it while the route runs.

        Raises:
            ServiceBusy: too many requests run and wait already.
        """
        if self._asked >= MOST_RUNNING + MOST_WAITING:
            raise ServiceBusy(f"{self._asked} {self._kind} are in progress.", REMEDY)
        self._asked += 1
        try:
            async with self._places():
                yield
        finally:
            self._asked -= 1

    async def stream(self, parts: Iterator[bytes]) -> AsyncIterator[bytes]:
        """Yield the parts of an answer; each part holds a place only until it is made.

        So a client that reads slowly does not block others. Once its answer has begun, a stream
        waits for a place without limit. If the limit is also a dependency of the route, the route
        refuses a stream while too many others wait.
        """
        while True:
            async with self._places():
                part = await run_sync(next, parts, None)
            if part is None:
                return
            yield part

    def _places(self) -> asyncio.Semaphore:
        # A semaphore belongs to the event loop in which a task waited for it.
        return self._running.setdefault(asyncio.get_running_loop(), asyncio.Semaphore(MOST_RUNNING))
