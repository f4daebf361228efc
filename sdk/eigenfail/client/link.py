"""Requests to a service, repeated if that is safe; its errors are raised here again."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial
from itertools import count
from logging import getLogger
from math import inf
from random import uniform
from time import monotonic, sleep
from typing import Any, TypeVar, get_args
from uuid import uuid4

import httpx2
import msgspec

from eigenfail import __version__, errors
from eigenfail.addresses import is_loopback
from eigenfail.filters import SortOrder
from eigenfail.values.campaign import Campaign
from eigenfail.values.records import Page
from eigenfail.values.rows import Rows
from eigenfail.wire import http
from eigenfail.wire.http import UNTYPED, Problem, make_error

Kind = TypeVar("Kind")
AWAY_S = 60.0


# Errors of a service that is started anew, or whose database is. Any other error is an answer.
AWAY = (errors.ServiceUnreachable, errors.StoreUnavailable, errors.ServiceBusy)


Tell = Callable[[Campaign], None]


def _let_time_pass(seconds: float) -> None:
    sleep(seconds)  # looked up at each call, so that tests can play time


rest: ContextVar[Callable[[float], None]] = ContextVar("rest", default=_let_time_pass)
"""What lets time pass between two looks of the blocking calls in this context. [s]"""


def wait_until(
    look: Callable[[], Kind],
    is_over: Callable[[Kind], bool],
    poll_s: float,
    timeout_s: float | None,
    describe: Callable[[Kind], str] = lambda _seen: "The operation",
) -> Kind:
    """Poll `look` until `is_over` is true of its value, and return that value.

    After the first answer the service may be unreachable for a minute, for example to restart.

    Args:
        look: returns the present state of the operation.
        is_over: whether the operation has ended.
        poll_s: time between two polls.
        timeout_s: time limit; None waits forever.
        describe: returns the operation's name and progress, for the error.

    Raises:
        WaitTimeout: it did not end in time; it continues to run.
    """
    latest_s = inf if timeout_s is None else monotonic() + timeout_s
    # The first look fails at once: a service that is not there, or a wrong address, is no restart.
    seen = look()
    while not is_over(seen):
        if monotonic() >= latest_s:
            raise errors.WaitTimeout(
                f"{describe(seen)} is still running after {timeout_s:g} s.",
                "Increase the timeout, or check the service's log if there is no progress.",
            )
        rest.get()(poll_s)
        seen = _look_until_back(look, poll_s, min(latest_s, monotonic() + AWAY_S))
    return seen


def _look_until_back(look: Callable[[], Kind], poll_s: float, until_s: float) -> Kind:
    """Return the state once the service answers; raise ServiceUnreachable after a time limit."""
    for tries in count():
        try:
            return look()
        except AWAY as error:
            if monotonic() >= until_s:
                raise
            if not tries:
                log.warning("%s The connection was lost; waiting for the service.", error.problem)
        rest.get()(poll_s)
    raise AssertionError("counting has no end")


@contextmanager
def check_during_waits(check: Callable[[], None]) -> Iterator[None]:
    """Call a check during all waits within the block."""

    def check_and_rest(seconds: float) -> None:
        check()
        sleep(seconds)

    token = rest.set(check_and_rest)
    try:
        yield
    finally:
        rest.reset(token)


@contextmanager
def report_progress(on_progress: Tell | None, progress: bool) -> Iterator[Tell]:
    """Return the reporter of a campaign's progress: a function, a display, both or none."""
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


# With the pauses below, four tries take about a second: the restart of a proxy, not of a service.
# Waits for campaigns last longer, in `wait_until`.
ATTEMPTS = 4


FIRST_PAUSE_S, JITTER_S = 0.1, 0.1


LONGEST_PAUSE_S = 30.0
"""How long a service may ask us to wait, and after how long nothing is asked again."""


# 429 and 503 are the service itself; 502 and 504 are a proxy before it that found nobody.
BUSY = frozenset({429, 502, 503, 504})


Answer = TypeVar("Answer")


log = getLogger("eigenfail.client")


def ask_again(ask: Callable[[], Answer]) -> Answer:
    """Return the answer after at most four tries; raise the error of the last one."""
    begun_s = monotonic()
    for tried in range(1, ATTEMPTS):
        try:
            return ask()
        except httpx2.HTTPError as error:
            if not is_worth_retrying(error) or monotonic() - begun_s > LONGEST_PAUSE_S:
                raise
            # `Retry-After` of the service wins: it knows when the next token of a key is there.
            pause_s = find_pause(error, tried)
            log.debug("try %d of %d failed, next in %.1f s: %s", tried, ATTEMPTS, pause_s, error)
        rest.get()(pause_s)
    return ask()


def is_worth_retrying(error: httpx2.HTTPError) -> bool:
    """Return whether the service was busy or did not answer."""
    if isinstance(error, httpx2.HTTPStatusError):
        return error.response.status_code in BUSY
    return isinstance(error, httpx2.TransportError)


def find_pause(error: httpx2.HTTPError, tried: int) -> float:
    """Return how long to wait: as the service says, or else longer after each try. [s]"""
    if isinstance(error, httpx2.HTTPStatusError):
        asked = error.response.headers.get("Retry-After", "")
        if asked.isdecimal():
            return min(float(asked), LONGEST_PAUSE_S)
    return FIRST_PAUSE_S * 2.0 ** (tried - 1) + uniform(0.0, JITTER_S)  # noqa: S311 - no secret


# A comparison takes long, and an explanation, for which a failure is run twice, up to 110 s. A
# service that is not there refuses at once.
TIMEOUT = httpx2.Timeout(60.0, connect=3.0, read=120.0)


STREAM_TIMEOUT = httpx2.Timeout(60.0, connect=3.0, read=45.0)
"""The service breaks the silence of a stream every 15 s. Three silences are no late heartbeat but a
connection that is dead without a word, as behind a proxy that was cut off."""


SCHEMES = ("http://", "https://")


LIKE = "http://127.0.0.1:8440"


PAGE = 200


Params = Mapping[str, int | str | None]


class Extent(msgspec.Struct, frozen=True):
    """Ways to count the rows of a list and to read it backwards, and the fields of a row.

    Attributes:
        count: returns the number of rows; None: they are counted one by one.
        reverse: parameters that list the same rows in reverse order; None if that order does not
            exist.
        fields: names of the requested fields; empty: rows are whole values.
    """

    count: Callable[[], int] | None = None
    reverse: Params | None = None
    fields: tuple[str, ...] = ()


class Link:
    """HTTP connection to one service.

    Args:
        base_url: URL of the service, without /api/v1.
        transport: replaces sockets.
        key: API key sent with each request; None sends no key.

    Raises:
        InvalidValue: the address is not an HTTP address.
    """

    def __init__(
        self,
        base_url: str,
        transport: httpx2.BaseTransport | None = None,
        key: str | None = None,
    ) -> None:
        if not str(base_url).startswith(SCHEMES):  # also of what is no text
            raise errors.InvalidValue(
                "url", f"'{base_url}' is not an address.", f"Use the form {LIKE}."
            )
        self.base_url = base_url
        authorization = {} if key is None else {"Authorization": f"Bearer {key}"}
        self._http = httpx2.Client(
            base_url=base_url,
            transport=transport,
            timeout=TIMEOUT,
            # A proxy of the environment would look for the service on its own machine.
            trust_env=not is_loopback(httpx2.URL(base_url).host),
            headers={"User-Agent": f"eigenfail/{__version__}", **authorization},
        )

    def get(self, path: str, kind: type[Kind], params: Params | None = None) -> Kind:
        """GET a path; retried while the service is busy or unreachable for a moment."""
        return http.decode(self._repeatedly("GET", path, params=_drop_missing(params)), kind)

    def get_bytes(self, path: str, params: httpx2.QueryParams, read_s: float) -> bytes:
        """GET the bytes of a file, with a timeout in seconds."""
        timeout = httpx2.Timeout(60.0, connect=3.0, read=read_s)
        return self._repeatedly("GET", path, params=params, timeout=timeout)

    def chunks(self, path: str, params: Params) -> Iterator[bytes]:
        """Yield the bytes of a file of any size as they arrive; the request is sent once."""
        asked = _drop_missing(params)
        with self._understood(), self._http.stream("GET", http.PREFIX + path, params=asked) as file:
            # The body of a stream is not read by itself, and a refusal says in it what is wrong.
            if file.is_error:
                file.read()
            file.raise_for_status()
            yield from file.iter_bytes()

    def post(self, path: str, kind: type[Kind], body: object = None) -> Kind:
        """POST a request once, and return its answer."""
        # An answer that was lost does not say whether it was done: a second key would be made.
        with self._understood():
            return http.decode(self._once("POST", path, content=_encode_body(body)), kind)

    def post_once_only(
        self, path: str, kind: type[Kind], body: object = None, key: str | None = None
    ) -> Kind:
        """POST a request that the service carries out once, even if it is sent repeatedly.

        Args:
            path: path of the request.
            kind: kind of its answer.
            body: the content of the request.
            key: permanent idempotency key of this request; None makes one for this call.
        """
        # The same key at each try: an answer that was lost must not make a second campaign.
        headers = {http.IDEMPOTENCY_KEY: key or str(uuid4())}
        answer = self._repeatedly("POST", path, content=_encode_body(body), headers=headers)
        return http.decode(answer, kind)

    def put(self, path: str, kind: type[Kind], body: object) -> Kind:
        """PUT a value; a repeated request has the same effect as one."""
        return http.decode(self._repeatedly("PUT", path, content=_encode_body(body)), kind)

    def delete(self, path: str, kind: type[Kind]) -> Kind:
        """DELETE a path; a repeated request has the same effect as one."""
        return http.decode(self._repeatedly("DELETE", path), kind)

    def pages(
        self,
        path: str,
        kind: type[Page[Kind]],
        cursor: str,
        params: Params | None = None,
        extent: Extent | None = None,
    ) -> Rows[Kind]:
        """Return the rows of a list, loaded page by page on demand.

        Args:
            path: path of the list.
            kind: kind of its pages.
            cursor: name of the parameter that requests the next page.
            params: further parameters.
            extent: ways to count the rows and to read them backwards.
        """
        known = extent or Extent()

        def iterate(asked: Params | None, most: float) -> Iterator[Kind]:
            query: dict[str, int | str | None] = {"limit": PAGE, **(asked or {})}
            while most > 0:
                query["limit"] = int(min(PAGE, most))
                page = self.get(path, kind, query)
                yield from page.items
                if page.next is None:
                    return
                # A cursor and no offset: rows that arrive meanwhile shift no page.
                query[cursor] = page.next
                most -= len(page.items)

        return Rows(
            lambda: iterate(params, inf),
            start=partial(iterate, params),
            count=known.count,
            backwards=None if known.reverse is None else partial(iterate, known.reverse),
            of=known.fields or get_args(kind)[0],
        )

    def count(self, path: str, params: Params | None = None) -> int:
        """Return the number of items that match a request, on all pages of a list together.

        Raises:
            ProtocolError: the service does not report the number.
        """
        page = self.get(path, Page[Any], {**(params or {}), "limit": 1, "total": "true"})
        if isinstance(page.total, msgspec.UnsetType):
            raise errors.ProtocolError(f"{self.base_url} does not say how many items {path} has.")
        return page.total

    @contextmanager
    def stream(
        self, path: str, params: Params, headers: Mapping[str, str]
    ) -> Iterator[Iterator[httpx2.ServerSentEvent]]:
        """Yield server-sent events; the end of the connection is a httpx2.TransportError."""
        asked = _drop_missing(params)
        with self._http.sse(
            http.PREFIX + path, params=asked, headers=dict(headers), timeout=STREAM_TIMEOUT
        ) as source:
            if source.response.is_error:
                source.response.read()
                raise read_refusal(source.response)
            yield iter(source)

    def trouble(self, path: str) -> errors.EigenfailError | None:
        """Return the error that a path outside the API reports; ServiceUnreachable if no answer."""
        try:
            answer = self._http.get(path, timeout=3.0)
        except httpx2.TransportError as error:
            return self.unreachable(error)
        return None if answer.is_success else read_refusal(answer)

    def close(self) -> None:
        """Close all connections."""
        self._http.close()

    def unreachable(self, error: httpx2.TransportError) -> errors.ServiceUnreachable:
        """Return the error to raise if no answer came."""
        return errors.ServiceUnreachable(
            f"No eigenfail service answers at {self.base_url} ({type(error).__name__}).",
            "Start one with `eigenfail up`, or give the address of one that runs, not of its hub"
            " (on the command line --url, or EIGENFAIL_URL).",
        )

    def _repeatedly(self, method: str, path: str, **request: Any) -> bytes:
        with self._understood():
            return ask_again(partial(self._once, method, path, **request))

    def _once(self, method: str, path: str, **request: Any) -> bytes:
        return self._http.request(method, http.PREFIX + path, **request).raise_for_status().content

    @contextmanager
    def _understood(self) -> Iterator[None]:
        """Turn errors of the transport into the documented errors of the client."""
        # Without this, httpx2 raises a RuntimeError, which no caller catches.
        if self._http.is_closed:
            problem = f"This client of {self.base_url} is closed, maybe with its service."
            raise errors.ServiceUnreachable(problem, "Create a new client.")
        try:
            yield
        except httpx2.HTTPStatusError as error:
            raise read_refusal(error.response) from None
        except httpx2.TransportError as error:
            raise self.unreachable(error) from error


def reverse_order(params: Params, sort: SortOrder, key: str) -> Params | None:
    """Return the parameters of a list with its last row first.

    Args:
        params: parameters of the list.
        sort: its order.
        key: column with a unique value in every row. The result is None for an order by another
            column, since rows without a value then come last in both directions.
    """
    if sort.column != key:
        return None
    turned = msgspec.structs.replace(sort, descending=not sort.descending)
    return {**params, "sort": str(turned)}


def read_refusal(response: httpx2.Response) -> errors.EigenfailError:
    """Return the error that a response describes."""
    try:
        return make_error(msgspec.json.decode(response.content, type=Problem))
    except msgspec.DecodeError:
        status = response.status_code
        detail = f"{response.url} answered with status {status} without an error description."
        remedy = "Make sure that an eigenfail service of this version listens there."
        untold = Problem(type=UNTYPED, title="", status=status, detail=detail, remedy=remedy)
        return make_error(untold)


def _encode_body(body: object) -> bytes:
    return b"" if body is None else http.encode(body)


def _drop_missing(params: Params | None) -> dict[str, int | str]:
    return {name: value for name, value in (params or {}).items() if value is not None}
