"""The same client for asynchronous programs.

There is one client, the blocking one: here each of its calls runs in a thread, and what is told of
its verbs there holds here. A verb that gives rows or events is iterated with `async for`, every
other one is awaited. Cancelling the wait, or a time-out of it, ends the call
as well: a wait between two looks, a pause between two tries and a stream of events at once, a
single request when its answer is in.
"""

import inspect
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import partial, update_wrapper
from itertools import islice
from threading import Event
from types import TracebackType
from typing import Any, Generic, NoReturn, Self, SupportsIndex, TypeVar, get_origin

import httpx2
from anyio import CapacityLimiter, get_cancelled_exc_class, to_thread

from eigenfail.client.client import Client
from eigenfail.client.link import PAGE, Waiter, waiter
from eigenfail.frames import SHOWN, Rows

Row = TypeVar("Row")
Answer = TypeVar("Answer")

AT_ONCE = 64
"""How many calls run at once, each in a thread; further ones wait for their turn."""


class GivenUp(Exception):
    """Ends a call that was cancelled; no caller receives it."""


class Ending(Waiter):
    """Waits until the call is cancelled."""

    def __init__(self) -> None:
        self._over = Event()
        self._cuts: list[Callable[[], None]] = []

    def rest(self, seconds: float) -> None:
        """Wait between two looks; raise GivenUp once the call is cancelled."""
        if self._over.wait(seconds):
            raise GivenUp

    @contextmanager
    def cutting(self, cut: Callable[[], None]) -> Iterator[None]:
        """Call `cut` when the call is cancelled within the block."""
        self._cuts.append(cut)
        try:
            yield
        finally:
            self._cuts.remove(cut)

    def end(self) -> None:
        """Cancel the call."""
        self._over.set()
        for cut in tuple(self._cuts):
            cut()


class Threads:
    """Where blocking calls run."""

    def __init__(self, at_once: int) -> None:
        self._limiter = CapacityLimiter(at_once)

    async def run(self, call: Callable[[], Answer], ending: Ending | None = None) -> Answer:
        """What a call answers; a cancellation ends it."""
        ending = ending or Ending()

        def within() -> Answer:
            waiter.set(ending)
            return call()

        try:
            return await to_thread.run_sync(within, abandon_on_cancel=True, limiter=self._limiter)
        except get_cancelled_exc_class():
            ending.end()
            raise


class AsyncRows(Generic[Row]):
    """Rows or events, as they come.

    Args:
        threads: where they are fetched.
        begin: the blocking call that gives them.
    """

    def __init__(self, threads: Threads, begin: Callable[[], Iterable[Row]]) -> None:
        self._threads = threads
        self._begin = begin

    def __repr__(self) -> str:
        """How to get at them; asks nothing."""
        return (
            "<AsyncRows: async for, or await count(), rows[i], rows[i:j], first(n), "
            "to_pandas(), to_arrow(), to_numpy()>"
        )

    async def __aiter__(self) -> AsyncIterator[Row]:
        """All of them: rows page by page, events one by one."""
        source, ending = self._begin(), Ending()
        rows, portion = iter(source), PAGE if isinstance(source, Rows) else 1
        try:
            while found := await self._threads.run(partial(take_rows, rows, portion), ending):
                for row in found:
                    yield row
        finally:
            ending.end()
            with suppress(ValueError):  # a thread is in it still, and about to leave
                getattr(rows, "close", lambda: None)()

    def __iter__(self) -> NoReturn:
        """Refuse a plain `for`, which would count up places without an end."""
        raise TypeError(
            "Rows and events of an AsyncClient are iterated with `async for`; "
            "`await rows.first(n)` and `await rows[i:j]` are tuples."
        )

    def __getitem__(self, place: SupportsIndex | slice) -> Awaitable[Any]:
        """One row, or those of a slice as a tuple, once awaited: `await rows[-1]`."""
        return self._threads.run(lambda: self._rows()[place])

    async def count(self) -> int:
        """Return the number of rows; one request where the service counts them."""
        return await self._threads.run(lambda: self._rows().count())

    async def first(self, n: int = SHOWN) -> tuple[Row, ...]:
        """The first n of them, or all where there are fewer."""
        return await self._threads.run(lambda: self._rows().first(n))

    async def to_pandas(self) -> Any:
        """All rows as a data frame; raises as `Rows.to_pandas` does."""
        return await self._threads.run(lambda: self._rows().to_pandas())

    async def to_arrow(self) -> Any:
        """All rows as an Arrow table; raises as `Rows.to_arrow` does."""
        return await self._threads.run(lambda: self._rows().to_arrow())

    async def to_numpy(self) -> Any:
        """All rows as a structured array; raises as `Rows.to_numpy` does."""
        return await self._threads.run(lambda: self._rows().to_numpy())

    def _rows(self) -> Rows[Row]:
        source = self._begin()
        return source if isinstance(source, Rows) else Rows(lambda: iter(source))


class AsyncVerbs:
    """A client, or a resource of it, whose verbs are awaited or iterated asynchronously."""

    def __init__(self, blocking: object, threads: Threads) -> None:
        self._blocking = blocking
        self._threads = threads

    def __getattr__(self, name: str) -> Any:
        """The verb or resource of that name.

        Raises:
            AttributeError: the blocking client has none.
        """
        if name.startswith("_"):
            raise AttributeError(name)
        found = getattr(self._blocking, name)
        if inspect.ismethod(found):
            return verb(found, self._threads)
        return AsyncVerbs(found, self._threads) if hasattr(found, "_link") else found

    def __dir__(self) -> Iterable[str]:
        """The names of the blocking one."""
        return [*super().__dir__(), *(name for name in dir(self._blocking) if name[0] != "_")]


class AsyncClient(AsyncVerbs):
    """An eigenfail service, over HTTP, for asynchronous programs: the verbs of `Client`.

    Args:
        base_url: address of the service.
        transport: instead of sockets, as for `Client`.
        key: what the service asks for, as for `Client`.
        at_once: how many calls run at once; further ones wait for their turn.
    """

    def __init__(
        self,
        base_url: str | None = None,
        transport: httpx2.BaseTransport | None = None,
        at_once: int = AT_ONCE,
        key: str | None = None,
    ) -> None:
        super().__init__(Client(base_url, transport, key), Threads(at_once))

    def __repr__(self) -> str:
        """Where the service is."""
        return f"Async{self._blocking!r}"

    async def __aenter__(self) -> Self:
        """The client itself."""
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close it."""
        await self.close()


def verb(method: Callable[..., Any], threads: Threads) -> Callable[..., Any]:
    """A blocking method as one that is awaited, or whose rows are iterated with `async for`."""
    answer = inspect.signature(method).return_annotation
    gives_rows = get_origin(answer) in (Rows, Iterator)

    def call(*given: Any, **named: Any) -> Any:
        bound = partial(method, *given, **named)
        return AsyncRows(threads, bound) if gives_rows else threads.run(bound)

    return update_wrapper(call, method)


def take_rows(rows: Iterator[Row], n: int) -> tuple[Row, ...]:
    """The next n of them."""
    return tuple(islice(rows, n))
