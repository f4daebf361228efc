"""Hostile requests to a running API: over every route of its OpenAPI document, and below HTTP.

`python tests/fuzz/hostile_requests.py --requests 25000` starts a service of its own, prints its
seed, and fails if any answer is a 5xx (other than a 503 that says when to come again), if the log
holds a traceback, if memory grows without a bound, or if the service does not answer in the end.
"""

import argparse
import json
import os
import re
import secrets
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from http.client import HTTPException, HTTPResponse
from pathlib import Path
from random import Random
from threading import Thread
from typing import Any
from urllib.parse import quote, urlencode

import psutil
from accepted import accept_spec
from fastapi.routing import APIRoute

from eigenfail.testing.examples import collision, make_errored_result, result, spec
from eigenfail.values.access import KeyRequest, Scope
from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.records import Delivery
from eigenfail_api.app import FORMS, ROUTERS
from eigenfail_services.access import make_key
from eigenfail_services.store.store import open_store

REQUESTS = 25_000
THREADS = 4
PATIENCE_S = 60.0
"""Work in a process of its own begins within 20 s, or the request is refused. [s]"""
HALF_SENT_S = 2.0
"""For an answer to what may be no whole request; a fault that comes later is counted. [s]"""
SERVER_FAULT = re.compile(r'eigenfail_http_requests_total{.*status="(5\d\d)"')
MOST_READ = 1_000_000
SETTLED = 0.3
"""Share of the requests after which memory is expected to be flat."""

MOST_GROWN_MIB = 200.0
BELOW_HTTP = 0.15
"""Share of the requests that are no HTTP, or bent HTTP."""

TEXTS = (
    *(
        "",
        " ",
        "\x00",
        "a\x00b",
        "\ufeff",
        "\u202e",
        "\ud800",
        "\U0010ffff",
        "é" * 300,
        "x" * 9_000,
    ),
    *("../" * 12 + "etc/passwd", "..\\..\\x", "%00", "%2e%2e%2f", "'; DROP TABLE campaigns; --"),
    *('" OR 1=1 --', "<script>alert(1)</script>", "{{7*7}}", "${jndi:ldap://x}", "$(id)", "`id`"),
    *("NaN", "Infinity", "-Infinity", "1e999", "-0", "0x10", "٣", "1_000", "9" * 400, "true"),
    *("null", "[]", "{}", "a,b", ",", "1," * 500, "2026-02-30", "ef_1_" + "k" * 43, "os:system"),
    *(
        "\r\nX-Injected: 1",
        "file:///etc/passwd",
        "http://[::1",
        "robustness_m<1e999",
        "((((",
        "a==",
    ),
)
NUMBERS = (0, -1, 1, 2, 3, 10**6, 2**31, 2**53, 2**63 - 1, 2**63, -(2**63), 2**64, 10**40)
FLOATS = (0.5, -0.0, 1e-320, 1e308, -1e308, float("nan"), float("inf"), float("-inf"))
NESTED = (None, True, [], {}, [[]], [None] * 50, {"": None}, {"a": {"b": {"c": [1]}}}, [[0.1] * 9])
BODIES = (
    b"",
    b"\x00",
    b"{",
    b"null",
    b"[]",
    b'"text"',
    b"[" * 5_000,
    b'{"a":' * 3_000,
    b'{"name": "\xff\xfe"}',
    b'{"name": "\\ud800"}',
    b'{"episodes": NaN}',
    b'{"episodes": 1e999}',
    b'{"a": 1, "a": 2}',
    b"\x1f\x8b\x08\x00broken",
    b"\xff\xfe{\x00}\x00",
    b"a=1&a=2&=&%zz",
    b"9" * 5_000,
    b" " * 60_000,
    b'{"name": "' + b"n" * 60_000 + b'"}',
)
HEADERS = (
    ("Accept", "text/html"),
    ("Accept", "application/x-nothing;q=0"),
    ("Accept", "*/" * 500),
    ("Accept-Encoding", "gzip, br, \x7f"),
    ("Content-Encoding", "gzip"),
    ("Content-Type", "application/xml"),
    ("Content-Type", "application/json; charset=utf-7"),
    ("Content-Type", "multipart/form-data"),
    ("Content-Type", "multipart/form-data; boundary=" + "b" * 300),
    ("Content-Type", "application/x-www-form-urlencoded"),
    ("Cookie", "eigenfail_session=" + "s" * 4_000),
    ("Cookie", "=;;=,\xff"),
    ("Authorization", "Basic Og=="),
    ("Authorization", "Bearer"),
    ("Authorization", "Bearer ef_99999999999999999999999999_" + "x" * 43),
    ("Authorization", "Bearer \xff"),
    ("Host", ""),
    ("Host", "evil.example"),
    ("Host", "127.0.0.1:notaport"),
    ("Origin", "null"),
    ("Origin", "http://[::1"),
    ("If-None-Match", '"' + "e" * 4_000),
    ("Last-Event-ID", "-1"),
    ("Last-Event-ID", "9" * 400),
    ("Last-Event-ID", "\xb2"),
    ("HX-Request", "true"),
    ("HX-Current-URL", "http://[::1"),
    ("Range", "bytes=0-,-1,9-1"),
    ("X-Forwarded-For", "::ffff:1.2.3.4, garbage"),
    ("Expect", "100-continue"),
    ("Upgrade", "websocket"),
    ("Connection", "close, upgrade"),
    ("Traceparent", "00-" + "g" * 32 + "-0-0"),
)
COSTLY = ("/explanation", "/account", "/region", "/boxes", "/report", "/file")
FOUND_IF_COSTLY = 0.02
"""Where an answer takes a process of its own, few requests name something that is there."""

SAID = ("const", "default", "example")
"""Where a schema says itself what a value may be."""

METHODS = (
    "GET",
    "POST",
    "PUT",
    "PATCH",
    "DELETE",
    "HEAD",
    "OPTIONS",
    "TRACE",
    "CONNECT",
    "get",
    "X",
)
HEAD = b"%b %b HTTP/1.1\r\nHost: 127.0.0.1\r\n"
GARBAGE = (
    b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
    b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
    b"\r\n" * 50,
    b"GET\r\n\r\n",
    b"GET / HTTP/9.9\r\n\r\n",
    b"GET / HTTP/1.1\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n",
    b"GET / HTTP/1.0\r\n\r\n",
    b"GET http://evil/ HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
    b"OPTIONS * HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
    b"GET /%ff%fe/\xc3\xa9 HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
    b"GET /%ff%c0%ae%00 HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n folded: x\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nA : b\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nA: \x00\r\n\r\n",
    b"GET /" + b"a" * 70_000 + b" HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n" + b"A: b\r\n" * 20_000 + b"\r\n",
    b"POST /login HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: -1\r\n\r\n",
    b"POST /login HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 9999999999999999999999\r\n\r\nx",
    HEAD % (b"POST", b"/login") + b"Content-Length: 5\r\nContent-Length: 6\r\n\r\nabcde",
    HEAD % (b"POST", b"/login")
    + b"Content-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n",
    b"POST /login HTTP/1.1\r\nHost: 127.0.0.1\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\nx\r\n",
    b"POST /login HTTP/1.1\r\nHost: 127.0.0.1\r\nTransfer-Encoding: chunked\r\n\r\n"
    + b"1\r\na\r\n" * 3_000,
    b"POST /login HTTP/1.1\r\nHost: 127.0.0.1\r\nTransfer-Encoding: chunked\r\n\r\n"
    b"5;" + b"e" * 20_000 + b"\r\nkey=a\r\n0\r\n\r\n",
    b"POST /login HTTP/1.1\r\nHost: 127.0.0.1\r\nTransfer-Encoding: gzip\r\n\r\nx",
    b"POST /api/v1/campaigns HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 2000000\r\n\r\n"
    + b"x" * 1_100_000,
    b"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n" * 60,
    b"GET /api/v1/events HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 4\r\n\r\nGET ",
)


@dataclass
class Sweep:
    """What came of the requests.

    Attributes:
        statuses: number of answers by status; 0 stands for a connection that was just closed.
        wrong: what an answer should not have been, with the request that got it.
        grown_mib: resident memory of the service, since the first third of the requests.
        log: what the service wrote.
        answers: whether it answered in the end.
    """

    statuses: Counter[int] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)
    grown_mib: float = 0.0
    log: str = ""
    answers: bool = False

    def complaints(self) -> list[str]:
        """Everything that must not be."""
        found = [*self.wrong]
        if "Traceback" in self.log:
            at = self.log.index("Traceback")
            told = [line for line in self.log[at:].splitlines() if "site-packages" not in line]
            found.append("\n".join(["A traceback is in the log:", *told[:80]]))
        if self.grown_mib > MOST_GROWN_MIB:
            found.append(f"Memory grew by {self.grown_mib:.0f} MiB.")
        if not self.answers:
            found.append("The service does not answer any more.")
        return found


class Target:
    """A service of its own, with a little in its database, and an administrator's key."""

    def __init__(self, folder: Path) -> None:
        self._url = f"sqlite:///{folder}/eigenfail.db"
        self._store = open_store(self._url)
        fill(self._store)
        self.renew_key()
        self.log = folder / "log"
        with self.log.open("wb") as log:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "eigenfail_api", "--database", self._url, "--port", "0"],
                stdout=subprocess.PIPE,
                stderr=log,
                env={**os.environ, "EIGENFAIL_MAX_REQUESTS_PER_S": "100000", "TMPDIR": str(folder)},
            )
        assert self._process.stdout is not None
        self.port = int(self._process.stdout.readline().rsplit(b":", 1)[1])

    def renew_key(self) -> None:
        """Make a key; a hostile request may have revoked the one before."""
        self.token = make_key(self._store, KeyRequest("sweep", Scope.ADMIN)).token

    def memory_mib(self) -> float:
        """Resident memory of the service."""
        return float(psutil.Process(self._process.pid).memory_info().rss) / 2**20

    def close(self) -> None:
        """End the service."""
        self._process.kill()
        self._process.communicate()
        self._store.close()


def fill(store: Any) -> None:
    """Campaign 1 with failures and an analysis, campaign 2 that waits."""
    full = store.campaigns.create(accept_spec(spec(episodes=20, name="full"))).id
    store.campaigns.move(full, "running")
    results = [
        collision(0),
        collision(1),
        make_errored_result(2),
        *(result(index) for index in range(3, 12)),
    ]
    store.episodes.commit(full, [Delivery(each, "w") for each in results])
    store.analyses.create(full, AnalysisSettings(clusters=1))
    store.campaigns.create(accept_spec(spec(episodes=5, name="empty")))


@contextmanager
def target() -> Iterator[Target]:
    """A service for as long as the block lasts."""
    with tempfile.TemporaryDirectory() as folder:
        started = Target(Path(folder))
        try:
            yield started
        finally:
            started.close()


@dataclass(frozen=True)
class Operation:
    """A method and a path with its parameters, and how its body looks."""

    method: str
    path: str
    query: tuple[str, ...] = ()
    body: Any = None


def operations(document: dict[str, Any]) -> list[Operation]:
    """Everything that the OpenAPI document has, and the dashboard's pages, which it has not."""
    found = []
    for path, item in document["paths"].items():
        for method, told in item.items():
            names = (one["name"] for one in told.get("parameters", ()) if one["in"] == "query")
            content = told.get("requestBody", {}).get("content", {})
            shape = content.get("application/json", {}).get("schema")
            body = None if shape is None else sample(shape, document, 6)
            found.append(Operation(method.upper(), path, tuple(names), body))
    known = {(each.method, each.path) for each in found}
    routes = [route for router in (*ROUTERS, *FORMS) for route in router.routes]
    for route in routes:
        if isinstance(route, APIRoute):
            names = [one.alias for one in route.dependant.query_params]
            more = (Operation(method, route.path, tuple(names)) for method in sorted(route.methods))
            found += [each for each in more if (each.method, each.path) not in known]
    return [*found, Operation("GET", "/static/{file}"), Operation("GET", "/openapi.json")]


def sample(schema: dict[str, Any], document: dict[str, Any], depth: int) -> Any:
    """A value that a schema describes, roughly: it is bent afterwards."""
    while "$ref" in schema:
        schema = document["components"]["schemas"][schema["$ref"].rsplit("/", 1)[1]]
    for key in SAID:
        if key in schema:
            return schema[key]
    for key in ("anyOf", "oneOf", "allOf"):
        if key in schema:
            return sample(schema[key][0], document, depth)
    kind = schema.get("type", "object")
    if kind == "object":
        fields = schema.get("properties", {}).items() if depth else ()
        return {name: sample(shape, document, depth - 1) for name, shape in fields}
    if kind == "array":
        items = schema.get("prefixItems") or [schema.get("items", {})]
        return [sample(each, document, depth - 1) for each in items] if depth else []
    return {"integer": schema.get("minimum", 1), "number": 1.0, "boolean": True}.get(kind, "a")


class Attacker:
    """Makes up requests, the same ones for one seed.

    Args:
        random: what they are drawn from.
        known: what may be asked for.
        target: whom it asks.
    """

    def __init__(self, random: Random, known: list[Operation], target: Target) -> None:
        self._random = random
        self._known = known
        self._target = target

    def request(self) -> tuple[bytes, float]:
        """The bytes of a request, and how long its answer is waited for. [s]"""
        if self._chance(BELOW_HTTP):
            return self._below_http(), HALF_SENT_S
        operation = self._random.choice(self._known)
        method = operation.method if self._chance(0.85) else self._random.choice(METHODS)
        address = self._path(operation) + self._query(operation)
        body, kind = self._body(operation) if method not in {"GET", "HEAD"} else (b"", "")
        headers = [("Host", f"127.0.0.1:{self._target.port}")]
        if self._chance(0.9):
            headers.append(("Authorization", f"Bearer {self._target.token}"))
        if kind:
            headers.append(("Content-Type", kind))
        if body or method not in {"GET", "HEAD"}:
            headers.append(("Content-Length", str(len(body))))
        for _ in range(self._random.choice((0, 0, 0, 1, 2))):
            name, value = self._random.choice(HEADERS)
            headers = [each for each in headers if each[0] != name or self._chance(0.2)]
            headers.append((name, value))
        lines = "".join(f"{name}: {value}\r\n" for name, value in headers)
        head = f"{method} {address} HTTP/1.1\r\n{lines}\r\n"
        return head.encode("latin-1", errors="replace") + body, PATIENCE_S

    def _chance(self, share: float) -> bool:
        return self._random.random() < share

    def _below_http(self) -> bytes:
        data = bytearray(self._random.choice(GARBAGE))
        for _ in range(self._random.choice((0, 0, 1, 5))):
            data[self._random.randrange(min(len(data), 200))] = self._random.randrange(256)
        return bytes(data)

    def _path(self, operation: Operation) -> str:
        costly, parts = operation.path.endswith(COSTLY), []
        for part in operation.path.split("/"):
            if part.startswith("{") and self._chance(FOUND_IF_COSTLY if costly else 0.5):
                parts.append(str(self._random.choice((1, 1, 2, 0, 3))))
            elif part.startswith("{"):
                parts.append(self._quoted(self._odd()))
            else:
                parts.append(part)
        path = "/".join(parts)
        tricks = ("/", "//", "/..", "/.", "%2f", "%0a", ";x=1", "?", "#", "/%2e%2e/%2e%2e/x")
        return path + self._random.choice(tricks) if self._chance(0.08) else path

    def _query(self, operation: Operation) -> str:
        named = [name for name in operation.query if self._chance(0.5)]
        if self._chance(0.1):
            named.append(self._random.choice(("x", "campaign", "limit", "a[]", "\ud800")))
        if not named:
            return ""
        pairs = [
            (self._safe(name), self._safe(self._odd()))
            for name in named
            for _ in range(self._random.choice((1, 1, 1, 3)))
        ]
        return "?" + urlencode(pairs)

    def _odd(self) -> str:
        kind = self._random.randrange(3)
        return str(self._random.choice((TEXTS, NUMBERS, FLOATS)[kind]))

    def _safe(self, text: str) -> bytes:
        return text.encode("utf-8", errors="surrogatepass")

    def _quoted(self, text: str) -> str:
        return quote(self._safe(text), safe=self._random.choice(("", "/.")))

    def _body(self, operation: Operation) -> tuple[bytes, str]:
        if operation.body is None:
            form = {
                self._random.choice(("key", "next", "name", "episodes", "id")): self._safe(
                    self._odd()
                )
            }
            return urlencode(form).encode(), "application/x-www-form-urlencoded"
        if self._chance(0.25):
            return self._random.choice(BODIES), "application/json"
        value = json.loads(json.dumps(operation.body))
        for _ in range(self._random.choice((0, 1, 1, 2, 4))):
            value = self._bend(value)
        return json.dumps(value).encode(), "application/json"

    def _bend(self, value: Any) -> Any:
        """The value with one of its parts exchanged, left out, or in excess."""
        if isinstance(value, dict) and value and self._chance(0.9):
            name = self._random.choice(sorted(value))
            if self._chance(0.15):
                return {key: kept for key, kept in value.items() if key != name}
            if self._chance(0.1):
                return {**value, self._odd(): self._leaf()}
            return {**value, name: self._bend(value[name])}
        if isinstance(value, list) and value and self._chance(0.7):
            return [self._bend(value[0])] * self._random.choice((1, 2, 300))
        return self._leaf()

    def _leaf(self) -> Any:
        return self._random.choice(self._random.choice((TEXTS, NUMBERS, FLOATS, NESTED)))


def ask(port: int, request: bytes, within_s: float = PATIENCE_S) -> tuple[int, str, bytes]:
    """Status, `Retry-After` and body of an answer; status 0 if the connection is just closed.

    What is no whole request is not answered at once: its sender hangs up when the time is over.

    Raises:
        TimeoutError: no answer came, and none was to be given up.
    """
    with socket.create_connection(("127.0.0.1", port), within_s) as peer:
        with suppress(ConnectionError):  # it may be refused before it was sent whole
            peer.sendall(request)
        answer = HTTPResponse(peer, method=request[:4].decode("latin-1").strip())
        try:
            answer.begin()
            is_endless = "event-stream" in answer.headers.get("content-type", "")
            body = b"" if is_endless else answer.read(MOST_READ)
        except (ConnectionError, HTTPException, ValueError):
            return 0, "", b""
        finally:
            answer.close()
        return answer.status, answer.headers.get("retry-after", ""), body


def is_wrong(status: int, retry_after: str) -> bool:
    """Whether an answer must not be: a 503 may, where it says when to come again."""
    return status >= 500 and not (status == 503 and retry_after)


def attack(attacker: Attacker, target: Target, requests: int, sweep: Sweep) -> None:
    """Send requests one after the other."""
    for _ in range(requests):
        request, within_s = attacker.request()
        try:
            status, retry_after, body = ask(target.port, request, within_s)
        except TimeoutError:
            status, retry_after, body = 0, "", b""
            if within_s == PATIENCE_S:
                sweep.wrong.append(f"No answer to {request[:1_000]!r}")
        sweep.statuses[status] += 1
        if (done := sweep.statuses.total()) % 2_500 == 0:
            print(f"{done} requests, {len(sweep.wrong)} wrong answers", flush=True)
        if is_wrong(status, retry_after):
            sweep.wrong.append(f"{status} {body[:300]!r} at {request[:1_000]!r}")
        if (
            status == 401
            and request.count(b"Authorization") == 1
            and target.token.encode() in request
        ):
            target.renew_key()


def sweep(requests: int, seed: int, threads: int = THREADS) -> Sweep:
    """Send so many hostile requests to a service of its own."""
    found = Sweep()
    with target() as asked:
        head = (
            HEAD % (b"GET", b"/openapi.json")
            + f"Authorization: Bearer {asked.token}\r\n\r\n".encode()
        )
        known = operations(json.loads(ask(asked.port, head)[2]))
        for share in (SETTLED, 1.0 - SETTLED):
            before_mib = asked.memory_mib()
            attackers = [
                Attacker(Random(f"{seed}/{share}/{n}"), known, asked) for n in range(threads)
            ]
            each = -(-int(requests * share) // threads)
            crowd = [Thread(target=attack, args=(one, asked, each, found)) for one in attackers]
            run(crowd)
        found.grown_mib = asked.memory_mib() - before_mib
        found.wrong += faults_counted(asked)
        status, *_ = ask(asked.port, HEAD % (b"GET", b"/readyz") + b"\r\n")
        found.answers = status == 200
        found.log = asked.log.read_text(errors="replace")
    return found


def faults_counted(target: Target) -> list[str]:
    """What the service counted as its own faults, whether or not anybody waited for the answer."""
    target.renew_key()
    key = f"Authorization: Bearer {target.token}\r\n\r\n".encode()
    _, _, body = ask(target.port, HEAD % (b"GET", b"/metrics") + key)
    return faults_in(body.decode())


def faults_in(metrics: str) -> list[str]:
    """The lines of `/metrics` that count answers of 500 and above, other than 503."""
    assert "eigenfail_http_requests_total" in metrics
    found = (SERVER_FAULT.match(line) for line in metrics.splitlines())
    return [f"Counted: {each.string}" for each in found if each and each[1] != "503"]


def run(crowd: list[Thread]) -> None:
    """Start all of them, and wait for them."""
    step: Callable[[Thread], None]
    for step in (Thread.start, Thread.join):
        for one in crowd:
            step(one)


def main() -> None:
    """Sweep, and say what came of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--requests", type=int, default=REQUESTS)
    parser.add_argument("--seed", type=int, default=secrets.randbelow(2**32))
    given = parser.parse_args()
    print(f"seed {given.seed}", flush=True)
    began_s = time.monotonic()
    found = sweep(given.requests, given.seed)
    took_s = time.monotonic() - began_s
    print(
        f"{found.statuses.total()} requests in {took_s:.0f} s, "
        f"by status: {dict(sorted(found.statuses.items()))}"
    )
    print(f"memory grew by {found.grown_mib:.0f} MiB after the first {SETTLED:.0%}")
    complaints = found.complaints()
    for complaint in complaints[:20]:
        print(complaint)
    print(f"{len(complaints)} complaints")
    if complaints:
        words = f"--requests {given.requests} --seed {given.seed}"
        print(f"The same again: python tests/fuzz/hostile_requests.py {words}")
        sys.exit(1)


if __name__ == "__main__":
    main()
