"""Requests, tried again where that is safe; answers, raising what the service raised."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from socket import MSG_PEEK, SHUT_RDWR, socket
from typing import Any, TypeVar
from uuid import uuid4

import httpx2
import msgspec

from eigenfail import __version__
from eigenfail.client.asking import ask_again
from eigenfail.client.waiting import waiter
from eigenfail.errors import EigenfailError, InvalidValue, ServiceUnreachable
from eigenfail.loopback import is_loopback
from eigenfail.rows import Rows
from eigenfail.values import Page
from eigenfail.wire import http
from eigenfail.wire.http import UNTYPED, Problem, make_error

TIMEOUT = httpx2.Timeout(60.0, connect=3.0)
STREAM_TIMEOUT = httpx2.Timeout(60.0, connect=3.0, read=45.0)
"""The service breaks the silence of a stream every 15 s."""

SCHEMES = ("http://", "https://")
LIKE = "http://127.0.0.1:8440"
PAGE = 200

FIRST_BYTE_S = 3.0
ZEROMQ_GREETING = b"\xff"

Kind = TypeVar("Kind")
Params = Mapping[str, int | str | None]


class Link:
    """The way to one service.

    Args:
        base_url: of the service, without /api/v1.
        transport: instead of sockets.
        key: what is shown to the service, if anything.

    Raises:
        InvalidValue: the address is none of HTTP.
    """

    def __init__(
        self,
        base_url: str,
        transport: httpx2.BaseTransport | None = None,
        key: str | None = None,
    ) -> None:
        if not base_url.startswith(SCHEMES):
            raise InvalidValue("url", f"'{base_url}' is not an address.", f"Write it like {LIKE}.")
        self.base_url = base_url
        self._http = httpx2.Client(
            base_url=base_url,
            transport=transport,
            timeout=TIMEOUT,
            trust_env=not is_loopback(httpx2.URL(base_url).host),
            headers={"User-Agent": f"eigenfail/{__version__}", **_make_headers(key)},
            event_hooks={"request": [_refuse_zeromq]},
        )

    def get(self, path: str, kind: type[Kind], params: Params | None = None) -> Kind:
        """What is at a path; asked again while the service is busy or away for a moment."""
        return http.decode(self._repeatedly("GET", path, params=_drop_missing(params)), kind)

    def get_bytes(self, path: str, params: httpx2.QueryParams, read_s: float) -> bytes:
        """The bytes of a file at a path, for which the service may take so many seconds."""
        timeout = httpx2.Timeout(60.0, connect=3.0, read=read_s)
        return self._repeatedly("GET", path, params=params, timeout=timeout)

    def chunks(self, path: str, params: Params) -> Iterator[bytes]:
        """The bytes of a file of any size, as they come; asked for once."""
        asked = _drop_missing(params)
        with self._understood(), self._http.stream("GET", http.PREFIX + path, params=asked) as file:
            if file.is_error:
                file.read()
            file.raise_for_status()
            yield from file.iter_bytes()

    def post(self, path: str, kind: type[Kind], body: object = None) -> Kind:
        """Have something done: asked once."""
        with self._understood():
            return http.decode(self._once("POST", path, content=_encode_body(body)), kind)

    def post_once_only(
        self, path: str, kind: type[Kind], body: object = None, key: str | None = None
    ) -> Kind:
        """Have something done that the service does once, however often it is asked.

        Args:
            path: of the request.
            kind: of its answer.
            body: what is sent.
            key: what tells this request from others, for ever; None makes one for this call.
        """
        headers = {http.IDEMPOTENCY_KEY: key or str(uuid4())}
        answer = self._repeatedly("POST", path, content=_encode_body(body), headers=headers)
        return http.decode(answer, kind)

    def delete(self, path: str, kind: type[Kind]) -> Kind:
        """Have something taken away, which is the same however often it is asked."""
        return http.decode(self._repeatedly("DELETE", path), kind)

    def pages(
        self, path: str, kind: type[Page[Kind]], cursor: str, params: Params | None = None
    ) -> Rows[Kind]:
        """All items of a list, page by page as they are wanted.

        Args:
            path: of the list.
            kind: of its pages.
            cursor: the parameter that asks for the next page.
            params: further ones.
        """

        def fetch() -> Iterator[Kind]:
            asked: dict[str, int | str | None] = {"limit": PAGE, **(params or {})}
            while True:
                page = self.get(path, kind, asked)
                yield from page.items
                if page.next is None:
                    return
                asked[cursor] = page.next

        return Rows(fetch)

    @contextmanager
    def stream(
        self, path: str, params: Params, headers: Mapping[str, str]
    ) -> Iterator[Iterator[httpx2.ServerSentEvent]]:
        """Server-sent events, until the connection ends; its end is a httpx2.TransportError."""
        asked = _drop_missing(params)
        with self._http.sse(
            http.PREFIX + path, params=asked, headers=dict(headers), timeout=STREAM_TIMEOUT
        ) as source:
            if source.response.is_error:
                source.response.read()
                raise read_refusal(source.response)
            with waiter.get().cutting(partial(_cut, source.response)):
                yield iter(source)

    def answers(self, path: str) -> bool:
        """Whether a path outside the API is well, as far as one request can tell."""
        return self.trouble(path) is None

    def trouble(self, path: str) -> EigenfailError | None:
        """What a path outside the API complains of; ServiceUnreachable if nothing answers."""
        try:
            answer = self._http.get(path, timeout=3.0)
        except httpx2.TransportError as error:
            return self.unreachable(error)
        except ServiceUnreachable as error:
            return error
        return None if answer.is_success else read_refusal(answer)

    def close(self) -> None:
        """Let go of all connections."""
        self._http.close()

    def unreachable(self, error: httpx2.TransportError) -> ServiceUnreachable:
        """What to raise when nothing came back."""
        return ServiceUnreachable(
            f"No eigenfail service answers at {self.base_url} ({type(error).__name__}).",
            "Start one with `eigenfail up`, or give the address of one that runs"
            " (on the command line --url, or EIGENFAIL_URL).",
        )

    def _repeatedly(self, method: str, path: str, **request: Any) -> bytes:
        with self._understood():
            return ask_again(partial(self._once, method, path, **request))

    def _once(self, method: str, path: str, **request: Any) -> bytes:
        return self._http.request(method, http.PREFIX + path, **request).raise_for_status().content

    @contextmanager
    def _understood(self) -> Iterator[None]:
        """Turn what the transport raises into what users are promised."""
        if self._http.is_closed:
            problem = f"This client of {self.base_url} is closed, maybe with its service."
            raise ServiceUnreachable(problem, "Make another one.")
        try:
            yield
        except httpx2.HTTPStatusError as error:
            raise read_refusal(error.response) from None
        except httpx2.TransportError as error:
            raise self.unreachable(error) from error


def read_refusal(response: httpx2.Response) -> EigenfailError:
    """Return the error that a response describes."""
    try:
        return make_error(msgspec.json.decode(response.content, type=Problem))
    except msgspec.DecodeError:
        status = response.status_code
        detail = f"{response.url} answered with status {status} and no reason."
        remedy = "Make sure that an eigenfail service of this version listens there."
        untold = Problem(type=UNTYPED, title="", status=status, detail=detail, remedy=remedy)
        return make_error(untold)


def _refuse_zeromq(request: httpx2.Request) -> None:
    """Have a request fail at once at the port of a hub, which speaks ZeroMQ and no HTTP.

    A hub speaks first, and its first byte ends no line: a client of HTTP would wait for the rest.
    """
    new: list[socket] = []

    def trace(step: str, info: dict[str, Any]) -> None:
        if step == "connection.connect_tcp.complete":
            new.append(info["return_value"].get_extra_info("socket"))
        elif step == "http11.receive_response_headers.started" and new:
            with suppress(OSError):
                connection = new.pop()
                connection.settimeout(FIRST_BYTE_S)
                if connection.recv(1, MSG_PEEK) == ZEROMQ_GREETING:
                    raise ServiceUnreachable(
                        f"What listens at {request.url.netloc.decode()} speaks ZeroMQ, as a hub "
                        "does to workers.",
                        "Give the address of the service itself, http://…; `eigenfail up` prints "
                        "both.",
                    )

    request.extensions = {**request.extensions, "trace": trace}


def _cut(response: httpx2.Response) -> None:
    """End a response from another thread than the one that reads it."""
    stream = response.extensions.get("network_stream")
    if stream is not None:
        with suppress(OSError):
            stream.get_extra_info("socket").shutdown(SHUT_RDWR)


def _make_headers(key: str | None) -> dict[str, str]:
    return {} if key is None else {"Authorization": f"Bearer {key}"}


def _encode_body(body: object) -> bytes:
    return b"" if body is None else http.encode(body)


def _drop_missing(params: Params | None) -> dict[str, int | str]:
    return {name: value for name, value in (params or {}).items() if value is not None}
