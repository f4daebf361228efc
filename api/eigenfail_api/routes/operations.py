"""Routes for operators: liveness, readiness, and metrics for Prometheus."""

import asyncio
import socket
import time
from collections import Counter as Tally
from collections import defaultdict
from collections.abc import Iterator, Mapping
from concurrent.futures import Future
from contextlib import suppress
from http import HTTPStatus
from threading import BoundedSemaphore, Thread
from typing import Annotated, NamedTuple

import prometheus_client
from fastapi import APIRouter, Depends, Query, Request
from fastapi.responses import PlainTextResponse
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from eigenfail.errors import EigenfailError, StoreUnavailable
from eigenfail.values.campaign import CampaignState
from eigenfail.values.operations import DAY_S, Presence, Staffing, WorkerShare
from eigenfail.values.records import Page
from eigenfail.wire.http import PREFIX, Health, make_problem, make_untyped_problem
from eigenfail_api.concurrency import ConcurrencyLimit
from eigenfail_api.openapi import document_route
from eigenfail_api.parameters import CampaignId, Json, Stored
from eigenfail_api.problems import answer
from eigenfail_services.campaigns import summary
from eigenfail_services.store.store import Store

MAX_AGE_S = 1.0
"""Time for which the outcome of a probe is reused. [s]"""


PROBE_LIMIT_S = 3.0
"""Time limit of a probe: containers and Kubernetes wait five seconds for an answer. [s]"""


LOOP_LIMIT_S = 1.0
"""Additional time for the event loop to begin and end a probe. [s]"""


MOST_PROBES = 64
HEAD_S = 3.0
HEAD_BYTES = 8 * 1024
"""At the port for health checks: requests at a time, and time and length of the head of each."""

RETRY_S = 0.1
"""Pause after a connection that the system could not accept. [s]"""


router = APIRouter(tags=["operations"])


# Each scrape reads all campaigns, so only a few run at a time.
SCRAPES = Depends(ConcurrencyLimit("scrapes"), scope="function")


class Readiness:
    """Checks that the store can be read and written, by a probe at most a second old.

    A probe runs in a thread of its own: it neither holds up the event loop nor waits behind
    requests that are themselves held up by the store. At most one runs at a time.
    """

    def __init__(self, store: Store) -> None:
        self._store = store
        self._probe: Future[None] | None = None
        self._began_s = 0.0

    async def check(self) -> None:
        """Raise StoreUnavailable if the store is not ready, or does not answer in time."""
        probe = self._current()
        try:
            # The probe is shielded: a client that hangs up must not cancel it for the others that
            # wait.
            await asyncio.wait_for(asyncio.shield(asyncio.wrap_future(probe)), PROBE_LIMIT_S)
        except TimeoutError:
            raise StoreUnavailable(
                f"The database did not answer within {PROBE_LIMIT_S:g} s.",
                "Check its disk or server; the service recovers automatically.",
            ) from None

    def _current(self) -> Future[None]:
        now_s = time.monotonic()
        last = self._probe
        if last is not None and (not last.done() or now_s - self._began_s < MAX_AGE_S):
            return last
        self._probe, self._began_s = Future(), now_s
        Thread(target=self._run, args=(self._probe,), name="readiness", daemon=True).start()
        return self._probe

    def _run(self, probe: Future[None]) -> None:
        try:
            self._store.ping()
        except BaseException as error:  # noqa: BLE001 - raised to the caller that waits
            probe.set_exception(error)
        else:
            probe.set_result(None)


class HealthServer:
    """Answers /healthz and /readyz at a socket of its own, in threads of its own.

    A client that takes all connections of the API takes none here. The API's event loop is asked
    each time: a process whose loop hangs is not healthy.

    Args:
        listener: the socket, which listens.
        readiness: checks the store.
    """

    def __init__(self, listener: socket.socket, readiness: Readiness) -> None:
        self._listener = listener
        self._checks = {"/healthz": _beat, "/readyz": readiness.check}
        self._places = BoundedSemaphore(MOST_PROBES)

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Begin to answer, until the socket is closed; `loop` is the event loop of the API."""
        Thread(target=self._accept, args=(loop,), name="health", daemon=True).start()

    def _accept(self, loop: asyncio.AbstractEventLoop) -> None:
        while True:
            try:
                connection, _ = self._listener.accept()
            except OSError:
                if self._listener.fileno() < 0:
                    return
                # A flood may leave no descriptor for a moment: probes are most wanted then.
                time.sleep(RETRY_S)
                continue
            # While all places are taken, further connections wait in the queue of the system.
            self._places.acquire()
            try:
                Thread(target=self._serve, args=(connection, loop), daemon=True).start()
            except RuntimeError:  # no thread can be started at present
                connection.close()
                self._places.release()

    def _serve(self, connection: socket.socket, loop: asyncio.AbstractEventLoop) -> None:
        """Answer one request; one that does not arrive in time gets no answer."""
        try:
            with connection, suppress(OSError):
                asked = read_probe(connection)
                connection.sendall(format_answer(self._check(asked.path, loop), asked.has_body))
        finally:
            self._places.release()

    def _check(self, path: str, loop: asyncio.AbstractEventLoop) -> Response:
        if path not in self._checks:
            known = f"This port has {' and '.join(self._checks)} alone."
            return answer(make_untyped_problem(404, known, path))
        asked = asyncio.run_coroutine_threadsafe(self._checks[path](), loop)
        try:
            asked.result(PROBE_LIMIT_S + LOOP_LIMIT_S)
        except EigenfailError as error:
            return answer(make_problem(error, path))
        except TimeoutError:
            asked.cancel()
            problem = f"The event loop did not answer within {PROBE_LIMIT_S + LOOP_LIMIT_S:g} s."
            return answer(make_untyped_problem(503, problem, path, "Start the process again."))
        except Exception as error:  # noqa: BLE001 - whatever a check raises, the probe has an answer
            problem = f"The check raised {type(error).__name__}: {error}"
            return answer(make_untyped_problem(503, problem, path, "Look into the log."))
        return Json(Health())


async def _beat() -> None:
    """Do nothing, in the event loop."""


class Probe(NamedTuple):
    """A request at the health port.

    Attributes:
        path: without its query; empty if it is not a request.
        has_body: whether its answer has a body, which that of HEAD has not.
    """

    path: str
    has_body: bool


def read_probe(connection: socket.socket) -> Probe:
    """Return a request.

    Raises:
        OSError: it did not arrive in time.
    """
    head, until_s = b"", time.monotonic() + HEAD_S
    while b"\r\n\r\n" not in head and len(head) < HEAD_BYTES:
        # The limit is for the whole head, so that a client cannot prolong it byte by byte.
        connection.settimeout(max(0.001, until_s - time.monotonic()))
        if not (part := connection.recv(HEAD_BYTES)):
            break
        head += part
    words = head.partition(b"\r\n")[0].split(b" ")
    is_read = len(words) == 3 and words[0] in {b"GET", b"HEAD"}
    path = words[1].partition(b"?")[0].decode("latin-1") if is_read else ""
    return Probe(path, words[0] != b"HEAD")


def format_answer(response: Response, has_body: bool) -> bytes:
    """Return an answer as HTTP/1.1, after which the connection is closed."""
    body = bytes(response.body) if has_body else b""
    phrase = HTTPStatus(response.status_code).phrase.encode()
    lines = [b"HTTP/1.1 %d %s" % (response.status_code, phrase)]
    lines += [b"%s: %s" % header for header in response.raw_headers]
    return b"\r\n".join((*lines, b"connection: close", b"", body))


@router.get("/healthz", **document_route(Health))
def get_health() -> Json:
    """Check that the process is alive."""
    return Json(Health())


@router.get("/readyz", **document_route(Health))
async def get_readiness(request: Request) -> Json:
    """Check that the service can read and write its database."""
    await request.app.state.readiness.check()
    return Json(Health())


@router.get("/metrics", response_class=PlainTextResponse, dependencies=[SCRAPES])
def get_metrics(request: Request) -> PlainTextResponse:
    """Get metrics for Prometheus."""
    text = prometheus_client.generate_latest(request.app.state.registry)
    return PlainTextResponse(text, media_type=prometheus_client.CONTENT_TYPE_LATEST)


METHODS = frozenset({"GET", "POST", "HEAD", "OPTIONS", "PUT", "PATCH", "DELETE"})


CLIENT_CLOSED = 499
"""Counted where the client disconnected before there was an answer; nginx uses this number."""


class CampaignCollector(Collector):
    """Collects metrics of all campaigns from the store at every scrape."""

    def __init__(self, store: Store) -> None:
        self._store = store

    def collect(self) -> Iterator[Metric]:
        """Yield the current metrics."""
        states, ends = Tally[str](dict.fromkeys(CampaignState, 0)), Tally[str]()
        failures = Tally[str]()
        hours, usd = defaultdict[str, float](float), defaultdict[str, float](float)
        for campaign in self._store.campaigns.iterate():
            counts, method = campaign.counts, campaign.spec.method
            states[campaign.state] += 1
            ends.update(completed=counts.completed, failed=counts.errored)
            failures[method] += counts.failures
            bill = summary.find_cost(campaign)
            hours[method] += bill.instance_hours
            usd[method] += bill.total_usd
        yield _make_family(GaugeMetricFamily, "campaigns", "Campaigns by state", "state", states)
        yield _make_family(CounterMetricFamily, "episodes", "Episodes ended", "end", ends)
        yield _make_family(CounterMetricFamily, "failures", "Failures found", "method", failures)
        yield _make_family(CounterMetricFamily, "instance_hours", "Instance-hours", "method", hours)
        yield _make_family(CounterMetricFamily, "cost_usd", "Total cost", "method", usd)


def _make_family(
    kind: type[GaugeMetricFamily] | type[CounterMetricFamily],
    name: str,
    words: str,
    label: str,
    values: Mapping[str, float],
) -> Metric:
    family = kind(f"eigenfail_{name}", words, labels=[label])
    for value, number in values.items():
        family.add_metric([value], number)
    return family


class RequestCounter:
    """Middleware: counts requests by method, route and status."""

    def __init__(self, app: ASGIApp, registry: prometheus_client.CollectorRegistry) -> None:
        self._app = app
        self._counter = prometheus_client.Counter(
            "eigenfail_http_requests",
            "Requests answered",
            ["method", "route", "status"],
            registry=registry,
        )

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, and count it; unexpected errors are answered further outside."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        status: int | None = None
        has_failed = True

        async def note_and_send(message: Message) -> None:
            nonlocal status
            status = message.get("status", status)
            await send(message)

        try:
            await self._app(scope, receive, note_and_send)
            has_failed = False
        finally:
            if status is None:
                status = 500 if has_failed else CLIENT_CLOSED
            # The number of time series is bounded, whatever clients send.
            method = scope["method"] if scope["method"] in METHODS else "other"
            route = getattr(scope.get("route"), "path", "none")
            self._counter.labels(method, route, str(status)).inc()


workers_router = APIRouter(prefix=PREFIX, tags=["workers"])


Within = Annotated[
    int, Query(ge=1, le=DAY_S, description="Only workers with results in this last time [s].")
]


@workers_router.get("/workers", **document_route(Page[WorkerShare]))
def list_workers(store: Stored, within_s: Within = summary.LATELY_S) -> Json:
    """List workers with recent results, by campaign; only recent results are counted."""
    return Json(Page(summary.list_recent_workers(store, within_s)))


@workers_router.get("/workers/present", **document_route(Page[Presence]))
def list_present_workers(store: Stored) -> Json:
    """List connected workers, working or idle: host, start of the connection, versions."""
    return Json(Page(summary.count_present(store)))


@workers_router.get("/workers/staffing", **document_route(Staffing))
def get_staffing(store: Stored) -> Json:
    """Get the number of workers, and the last report of the services that start them."""
    return Json(summary.find_staffing(store))


@workers_router.get("/campaigns/{campaign}/workers", **document_route(Page[WorkerShare]))
def list_campaign_workers(store: Stored, campaign: CampaignId) -> Json:
    """List the workers that ran a campaign's episodes, most episodes first."""
    return Json(Page(summary.find_worker_shares(store, store.campaigns.get(campaign))))
