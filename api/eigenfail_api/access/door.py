"""Whether a key is needed, and who shows which."""

from collections.abc import Callable
from contextlib import suppress
from threading import Lock

from starlette.requests import HTTPConnection

from eigenfail.contracts import Store
from eigenfail.errors import EigenfailError, Forbidden, NotFound, Unauthorized
from eigenfail.values.access import TOKEN, ApiKey, Scope
from eigenfail_api.access.attempts import Attempts
from eigenfail_api.access.callers import Caller, by_key
from eigenfail_api.access.pace import Pace
from eigenfail_api.access.scopes import SAFE
from eigenfail_api.access.sessions import COOKIE, Sessions
from eigenfail_api.settings import ApiSettings
from eigenfail_services.access.keys import no_valid_key, note_use, shown_key, valid

LOOKED_EVERY_MS = 1_000
"""How long it may take until a key that was made elsewhere locks the door."""

Clock = Callable[[], int]


class Door:
    """Lets in whoever may come in.

    Once a key was made, everybody needs one, for good: also when all of them are revoked.

    Args:
        store: of the keys.
        settings: whether a key is needed before there is one.
        clock: milliseconds since 1970.
    """

    def __init__(self, store: Store, settings: ApiSettings, clock: Clock) -> None:
        self.sessions = Sessions()
        self.clock = clock
        self._store = store
        self._attempts = Attempts()
        self._pace = Pace(settings.max_requests_per_s, "This key")
        self._keyless = Pace(settings.max_keyless_requests_per_s, "This address")
        self._lock = Lock()
        self._locked = settings.require_keys
        self._looked_ms: int | None = None
        self._made = 0
        self._nobody = Caller("loopback" if settings.is_private else "network", Scope.ADMIN)

    def is_locked(self) -> bool:
        """Whether a key is needed."""
        if not (self._locked or self._has_looked()):
            made = self._made
            # Nobody waits for an answer that somebody else asked the store for.
            exist = self._store.keys.exist()
            with self._lock:
                if exist:
                    self._locked = True
                if made == self._made:
                    self._looked_ms = self.clock()
        return self._locked

    def anybody(self, asked: HTTPConnection) -> Caller | None:
        """Whoever it is, where no key is needed as far as was seen a moment ago.

        Raises:
            HTTPException: 429, from there it was asked too often.
        """
        return None if self._locked or not self._has_looked() else self._stranger(asked)

    def _stranger(self, asked: HTTPConnection) -> Caller:
        self._keyless.take(address_of(asked), self.clock())
        return self._nobody

    def _has_looked(self) -> bool:
        seen_ms = self._looked_ms
        return seen_ms is not None and 0 <= self.clock() - seen_ms < LOOKED_EVERY_MS

    def look_again(self) -> None:
        """A key was made here just now."""
        with self._lock:
            self._made += 1
            self._looked_ms = None

    def caller(self, asked: HTTPConnection) -> Caller:
        """Who asks.

        Raises:
            Unauthorized: somebody without a valid key, where one is needed.
            Forbidden: a browser that does not say which page sends.
            HTTPException: 429, somebody who tried or asked too often.
        """
        if not self.is_locked():
            return self._stranger(asked)
        shown = asked.headers.get("authorization")
        if shown is not None:
            scheme, _, token = shown.partition(" ")
            token = token.strip() if scheme.lower() == "bearer" else ""
            return by_key(self.holder(token, address_of(asked)))
        return self._signed_in(asked)

    def holder(self, token: str, address: str) -> ApiKey:
        """The key that is shown at an address.

        Raises:
            Unauthorized: it is none that is valid.
            HTTPException: 429, too many wrong ones came from there, or it is used too often.
        """
        at_ms, match = self.clock(), TOKEN.fullmatch(token)
        named = match["id"] if match else ""
        try:
            key = shown_key(self._store, token, at_ms)
        except Unauthorized:
            # Whoever has the right one comes in: others must not be able to shut it out.
            self._attempts.refuse_too_many(address, named, at_ms)
            self._attempts.note_wrong(address, named, at_ms)
            raise
        return self._welcome(key, at_ms)

    def _signed_in(self, asked: HTTPConnection) -> Caller:
        at_ms = self.clock()
        number = self.sessions.key_of(asked.cookies.get(COOKIE, ""), at_ms)
        if number is None:
            raise no_valid_key()
        try:
            key = valid(self._store.keys.find(number).key, at_ms)
        except NotFound:
            raise no_valid_key() from None
        # The guard holds the Origin against the Host; here it is that there has to be one.
        if asked.scope["method"] not in SAFE and "origin" not in asked.headers:
            raise Forbidden(
                "This request does not say from which page it comes.",
                "Use the service's own pages, or send a key in `Authorization`.",
            )
        return by_key(self._welcome(key, at_ms), signed_in=True)

    def _welcome(self, key: ApiKey, at_ms: int) -> ApiKey:
        self._pace.take(key.id, at_ms)
        # What can be read is read, also where nothing can be written.
        with suppress(EigenfailError):
            note_use(self._store, key, at_ms)
        return key


def address_of(asked: HTTPConnection) -> str:
    """From where a request comes."""
    return asked.client.host if asked.client else ""
