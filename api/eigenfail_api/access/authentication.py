"""Authentication of callers: keys in headers, and sessions of browsers."""

import secrets
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass
from re import Pattern
from threading import Lock

from starlette.requests import HTTPConnection, Request
from starlette.routing import compile_path

from eigenfail.errors import EigenfailError, Forbidden, NotFound, Unauthorized
from eigenfail.values.access import PROXY_PREFIX, TOKEN, ApiKey, Scope
from eigenfail.wire.http import PREFIX
from eigenfail_api.access.proxy import ProxySignIn
from eigenfail_api.access.throttling import LoginThrottle, RateLimiter
from eigenfail_api.settings import ApiSettings
from eigenfail_services import access
from eigenfail_services.store.store import Store

SAFE = frozenset({"GET", "HEAD", "OPTIONS"})
"""Methods that change nothing."""


OPEN = ("GET /healthz", "GET /readyz", "GET /login", "POST /login", "GET /static/{file:path}")
"""Requests that require no key."""


# Reading requires a viewer and everything else an administrator, unless this table differs.
REQUIRED: Mapping[Scope, tuple[str, ...]] = {
    # Requests that send a body but change nothing that others see.
    Scope.VIEWER: (
        f"POST {PREFIX}/campaigns/check",
        "POST /launch/form",
        "POST /logout",
        "POST /launch/suite",
    ),
    Scope.RUNNER: (
        f"POST {PREFIX}/campaigns",
        f"POST {PREFIX}/campaigns/bulk",
        f"POST {PREFIX}/campaigns/{{campaign}}/clone",
        f"POST {PREFIX}/campaigns/{{campaign}}/pause",
        f"POST {PREFIX}/campaigns/{{campaign}}/resume",
        f"POST {PREFIX}/campaigns/{{campaign}}/cancel",
        f"POST {PREFIX}/campaigns/{{campaign}}/archive",
        f"POST {PREFIX}/campaigns/{{campaign}}/restore",
        f"POST {PREFIX}/campaigns/{{campaign}}/priority",
        f"POST {PREFIX}/campaigns/{{campaign}}/analyses",
        f"POST {PREFIX}/campaigns/{{campaign}}/episodes/{{index}}/replay",
        f"POST {PREFIX}/campaigns/{{campaign}}/episodes/{{index}}/shrink",
        f"POST {PREFIX}/analyses/{{analysis}}/proof",
        f"PUT {PREFIX}/analyses/{{analysis}}/modes/{{mode}}/name",
        f"POST {PREFIX}/gates",
        f"POST {PREFIX}/suites",
        f"POST {PREFIX}/analyses/{{analysis}}/modes/{{mode}}/triage",
        "POST /analyses/{analysis}/modes/{mode}/triage",
    ),
    Scope.ADMIN: (
        "GET /audit",
        "GET /keys",
        f"GET {PREFIX}/audit",
        f"GET {PREFIX}/keys",
        f"GET {PREFIX}/keys/{{key}}",
        f"POST {PREFIX}/keys",
        f"POST {PREFIX}/keys/{{key}}/quotas",
        f"GET {PREFIX}/keys/{{key}}/usage",
        f"DELETE {PREFIX}/keys/{{key}}",
    ),
}


Rule = tuple[str, Pattern[str], Scope | None]
"""Method, pattern of the address, and the least scope; None: no key is required."""


def compile_rules(scope: Scope | None, lines: Iterable[str]) -> Iterator[Rule]:
    """Yield the rules of requests such as "POST /logout", which all require a scope."""
    for method, address in (line.split(" ") for line in lines):
        yield method, compile_path(address)[0], scope


RULES = tuple(
    rule
    for scope, lines in ((None, OPEN), *REQUIRED.items())
    for rule in compile_rules(scope, lines)
)


def required_scope(method: str, path: str, rules: Iterable[Rule] = RULES) -> Scope | None:
    """Return the least scope that a request requires; None if it requires no key."""
    asked = "GET" if method == "HEAD" else method
    for known, pattern, scope in rules:
        # As the router does: its pattern also takes a newline behind the address.
        if known == asked and pattern.match(path):
            return scope
    return Scope.VIEWER if asked == "GET" else Scope.ADMIN


def is_change(method: str, path: str, rules: Iterable[Rule] = RULES) -> bool:
    """Return whether a request changes something and therefore belongs in the audit log."""
    return method not in SAFE and required_scope(method, path, rules) in {
        Scope.RUNNER,
        Scope.ADMIN,
    }


@dataclass(frozen=True)
class Caller:
    """The sender of a request.

    Attributes:
        name: name of the key; `loopback` or `network` if no key is required; `proxy:` and the
            name of the user whom a proxy signed in.
        scope: what the key, or the groups of the user, allow.
        key: id of the key; None without one.
        signed_in: whether a browser is signed in, by a key on the login page or by a proxy.
    """

    name: str
    scope: Scope
    key: int | None = None
    signed_in: bool = False

    @property
    def description(self) -> str:
        """Return the caller in a sentence about the scope: a key, or a user without one."""
        return f"the {'user' if self.key is None else 'key of'} '{self.name}'"


_caller: ContextVar[Caller | None] = ContextVar("caller", default=None)


@contextmanager
def act_as(caller: Caller | None) -> Iterator[None]:
    """Answer requests of this caller within the block."""
    before = _caller.set(caller)
    try:
        yield
    finally:
        _caller.reset(before)


def find_caller_without(scope: Scope) -> Caller | None:
    """Return the caller if the caller's key does not include the scope; else None."""
    caller = _caller.get()
    return None if caller is None or caller.scope.allows(scope) else caller


def get_signed_in_caller() -> Caller | None:
    """Return the caller who is signed in with a browser; None for other callers."""
    caller = _caller.get()
    return caller if caller is not None and caller.signed_in else None


async def get_caller_key() -> int | None:
    """Return the id of the caller's key; None if no key is required."""
    caller = _caller.get()
    return None if caller is None else caller.key


async def get_caller_name() -> str:
    """Return the name of the caller, as the audit log has it."""
    caller = _caller.get()
    return "unknown" if caller is None else caller.name


def caller_of_key(key: ApiKey, *, signed_in: bool = False) -> Caller:
    """Return the holder of a key."""
    return Caller(key.name, key.scope, key.id, signed_in)


KEY_CHECK_MS = 1_000
"""Maximum delay until the first key, made by another process, is required here."""


SESSION_COOKIE = "eigenfail_session"


SESSION_S = 12 * 3_600


MOST_SESSIONS = 1_000


TOKEN_BYTES = 32


Clock = Callable[[], int]


@dataclass(frozen=True)
class _Session:
    key: int
    ends_ms: int


class Sessions:
    """Sessions of browsers: a cookie with a random token represents a key.

    Tokens are kept only in this process: after a restart, people sign in again. If there are too
    many sessions, the oldest one ends.
    """

    def __init__(self) -> None:
        self._lock = Lock()
        self._open: dict[str, _Session] = {}

    def open(self, key: int, at_ms: int) -> str:
        """Open a session for the holder of a key; return its token."""
        token = secrets.token_urlsafe(TOKEN_BYTES)
        with self._lock:
            while len(self._open) >= MOST_SESSIONS:
                del self._open[next(iter(self._open))]
            self._open[token] = _Session(key, at_ms + 1_000 * SESSION_S)
        return token

    def key_of(self, token: str, at_ms: int) -> int | None:
        """Return the id of the key that a token represents; None without an open session."""
        with self._lock:
            session = self._open.get(token)
            if session is not None and at_ms >= session.ends_ms:
                del self._open[token]
                return None
        return None if session is None else session.key

    def close(self, token: str) -> None:
        """End the session of a token."""
        with self._lock:
            self._open.pop(token, None)


class Authenticator:
    """Identifies callers, and limits the rate of their requests.

    Once a key has been made, keys are always required, even after all keys are revoked.

    Args:
        store: store of the keys.
        settings: whether a key is required before there is one.
        clock: milliseconds since 1970.
    """

    def __init__(self, store: Store, settings: ApiSettings, clock: Clock) -> None:
        self.sessions = Sessions()
        self.clock = clock
        self._store = store
        self._throttle = LoginThrottle()
        self._per_key = RateLimiter(settings.max_requests_per_s, "This key")
        self._per_user = RateLimiter(settings.max_requests_per_s, "This user")
        self._per_address = RateLimiter(settings.max_keyless_requests_per_s, "This address")
        self._lock = Lock()
        self._proxy = ProxySignIn(settings)
        self._requires_keys = settings.require_keys or bool(settings.sign_in_proxies)
        self._checked_ms: int | None = None
        self._keys_made = 0
        self._anonymous = Caller("loopback" if settings.is_private else "network", Scope.ADMIN)

    def requires_keys(self) -> bool:
        """Return whether a key is required."""
        if not (self._requires_keys or self._has_checked()):
            keys_made = self._keys_made
            # The lock is not held meanwhile: no caller waits for a query of another one.
            exist = self._store.keys.exist()
            with self._lock:
                if exist:
                    self._requires_keys = True
                if keys_made == self._keys_made:
                    self._checked_ms = self.clock()
        return self._requires_keys

    def identify_anonymous(self, request: HTTPConnection) -> Caller | None:
        """Return the anonymous caller if no key was required a moment ago; reads no database.

        Raises:
            HTTPException: 429, too many requests came from this address.
        """
        if self._requires_keys or not self._has_checked():
            return None
        return self._admit_anonymous(request)

    def _admit_anonymous(self, request: HTTPConnection) -> Caller:
        self._per_address.take(address_of(request), self.clock())
        return self._anonymous

    def _has_checked(self) -> bool:
        checked_ms = self._checked_ms
        return checked_ms is not None and 0 <= self.clock() - checked_ms < KEY_CHECK_MS

    def note_new_key(self) -> None:
        """Check at the next request whether keys are required: one was made just now."""
        with self._lock:
            self._keys_made += 1
            self._checked_ms = None

    def identify(self, request: HTTPConnection) -> Caller:
        """Return the caller of a request.

        Raises:
            Unauthorized: a key is required, and the request lacks a valid one.
            Forbidden: a browser's request does not name the page that sends it; or a proxy does
                not name exactly one user, or names a user without a scope.
            HTTPException: 429, too many requests or failed logins.
        """
        if not self.requires_keys():
            return self._admit_anonymous(request)
        if (user := self._proxy.find_user(request)) is not None:
            # A browser sends the proxy's cookie by itself, as it sends that of a session.
            _refuse_without_origin(request)
            name = f"{PROXY_PREFIX}{user.name}"
            self._per_user.take(name, self.clock())
            return Caller(name, user.scope, signed_in=True)
        header = request.headers.get("authorization")
        if header is None:
            return self._identify_session(request)
        scheme, _, token = header.partition(" ")
        token = token.strip() if scheme.lower() == "bearer" else ""
        return caller_of_key(self.verify_token(token, address_of(request)))

    def verify_token(self, token: str, address: str) -> ApiKey:
        """Return the key of a token that was sent from an address.

        Raises:
            Unauthorized: the token belongs to no valid key.
            HTTPException: 429, too many failed logins from there, or the key is used too often.
        """
        at_ms, match = self.clock(), TOKEN.fullmatch(token)
        key_id = match["id"] if match else ""
        try:
            key = access.authenticate_key(self._store, token, at_ms)
        except Unauthorized:
            # The right token is accepted at any time: others must not be able to lock it out.
            self._throttle.refuse_too_many(address, key_id, at_ms)
            self._throttle.count_failure(address, key_id, at_ms)
            raise
        return self._admit(key, at_ms)

    def _identify_session(self, request: HTTPConnection) -> Caller:
        at_ms = self.clock()
        key_id = self.sessions.key_of(request.cookies.get(SESSION_COOKIE, ""), at_ms)
        if key_id is None:
            raise access.make_invalid_key_error()
        try:
            key = access.require_valid(self._store.keys.find(key_id).key, at_ms)
        except NotFound:
            raise access.make_invalid_key_error() from None
        _refuse_without_origin(request)
        return caller_of_key(self._admit(key, at_ms), signed_in=True)

    def _admit(self, key: ApiKey, at_ms: int) -> ApiKey:
        self._per_key.take(key.id, at_ms)
        # Reading goes on where the database cannot be written.
        with suppress(EigenfailError):
            access.note_use(self._store, key, at_ms)
        return key


def _refuse_without_origin(request: HTTPConnection) -> None:
    """Refuse a browser's change that does not name its page; `OriginGuard` compares the name.

    Raises:
        Forbidden: the request is a change without an Origin header.
    """
    if request.scope["method"] not in SAFE and "origin" not in request.headers:
        raise Forbidden(
            "The request does not state its origin.",
            "Use the pages of this service, or send a key in `Authorization`.",
        )


async def authenticator_of(request: Request) -> Authenticator:
    """Return the application's authenticator."""
    authenticator: Authenticator = request.app.state.authenticator
    return authenticator


def address_of(request: HTTPConnection) -> str:
    """Return the network address of a caller."""
    return request.client.host if request.client else ""
