"""API keys: secrets, holders, and the first key, which turns authentication on."""

import hashlib
import hmac
import secrets
from contextlib import closing
from pathlib import Path

import msgspec

from eigenfail.errors import Conflict, InvalidValue, NotFound, Unauthorized
from eigenfail.files import replace_private
from eigenfail.values import access
from eigenfail.values.rows import Rows
from eigenfail.wire.http import PREFIX, read_fields
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.store import Store, open_store

SECRET_BYTES = 32


MINUTE_MS = 60_000


def make_key(store: Store, request: access.KeyRequest) -> access.NewKey:
    """Return a new key with its secret, which cannot be recovered later.

    Raises:
        InvalidValue: it would be the first key, but is not an administrator's; or its name is
            reserved for callers without a key.
    """
    access.check_key_name(request.name)
    at_ms = now_ms()
    if request.scope is not access.Scope.ADMIN and not store.keys.admins(at_ms):
        raise InvalidValue(
            "scope",
            "no administrator has a valid key yet, and the first key makes keys required for all "
            "requests.",
            "Create a key with the scope admin first.",
        )
    secret = secrets.token_urlsafe(SECRET_BYTES)
    expires_ms = None if request.expires_s is None else at_ms + 1_000 * request.expires_s
    key = store.keys.create(request.name, request.scope, digest(secret), expires_ms, request.quotas)
    return access.NewKey(key, f"ef_{key.id}_{secret}")


def revoke_key(store: Store, number: int) -> access.ApiKey:
    """Revoke a key, and return it.

    Raises:
        NotFound: the key does not exist.
        Conflict: it is the last administrator's key, without which no key could be created.
    """
    at_ms, key = now_ms(), store.keys.find(number).key
    is_admin = key.scope is access.Scope.ADMIN and key.is_valid(at_ms)
    if is_admin and store.keys.admins(at_ms) == 1:
        raise Conflict(
            f"Key {number} is the last administrator's key: without it no key could be created.",
            "Make another administrator's key first, then revoke this one.",
        )
    return store.keys.revoke(number)


def authenticate_key(store: Store, token: str, at_ms: int) -> access.ApiKey:
    """Return the key that a token belongs to, if the key is valid at a moment.

    Raises:
        Unauthorized: no key has this token, or the key is not valid; both in the same words.
    """
    match = access.TOKEN.fullmatch(token)
    if match is None:
        raise make_invalid_key_error()
    try:
        found = store.keys.find(int(match["id"]))
    # An unknown id is refused in the same words as a wrong secret: the answer must not reveal which
    # keys exist.
    except NotFound:
        raise make_invalid_key_error() from None
    # The comparison takes the same time however many characters match, so that its duration reveals
    # nothing.
    if not hmac.compare_digest(digest(match["secret"]), found.digest):
        raise make_invalid_key_error()
    return require_valid(found.key, at_ms)


def require_valid(key: access.ApiKey, at_ms: int) -> access.ApiKey:
    """Return a key that is valid at a moment.

    Raises:
        Unauthorized: the key is not valid.
    """
    if not key.is_valid(at_ms):
        raise make_invalid_key_error()
    return key


def note_use(store: Store, key: access.ApiKey, at_ms: int) -> None:
    """Record that a key is in use, at most once a minute."""
    # Otherwise every request would be a write, for which other writers wait.
    if key.last_used_ms is None or at_ms - key.last_used_ms >= MINUTE_MS:
        store.keys.used(key.id, at_ms)


def digest(secret: str) -> str:
    """Return the SHA-256 of a secret, in hexadecimal digits."""
    # A fast hash is enough: unlike a password, a secret of 256 random bits cannot be guessed.
    return hashlib.sha256(secret.encode()).hexdigest()


def make_invalid_key_error() -> Unauthorized:
    """Return the refusal of a request without a valid key."""
    return Unauthorized(
        "This service requires a valid key.",
        "Send `Authorization: Bearer ef_…`: set EIGENFAIL_KEY, or sign in at /login. "
        "`eigenfail key create` makes keys.",
    )


FIELD = "--file"


class FirstKey(msgspec.Struct, frozen=True):
    """The outcome of `make_first_key`, without the secret.

    Attributes:
        made: the key that was made; null if an administrator has one already.
        file: where its secret is.
    """

    made: access.ApiKey | None
    file: str


def make_first_key(store: Store, name: str, file: Path) -> FirstKey:
    """Create an administrator's key in a private file, unless an administrator has a valid key.

    An empty file shows that an earlier attempt was interrupted: then another key is created.

    Raises:
        InvalidValue: the file cannot be read or written, or the name is reserved for callers
            without a key; no key is made then.
    """
    broke_off = _is_empty(file)
    if store.keys.admins(now_ms()) and not broke_off:
        return FirstKey(None, str(file))
    access.check_key_name(name)
    # The file is created before the key: a key whose secret cannot be written would lock the
    # service, and nobody could open it.
    replace_private(file, "", FIELD)
    made = make_key(store, access.KeyRequest(name, access.Scope.ADMIN))
    replace_private(file, made.token, FIELD)
    return FirstKey(made.key, str(file))


def _is_empty(file: Path) -> bool:
    try:
        return not file.read_text().strip()
    except FileNotFoundError:
        return False
    except (OSError, UnicodeDecodeError) as error:
        problem = f"'{file}' cannot be read: {getattr(error, 'strerror', 'it is no text')}."
        raise InvalidValue(FIELD, problem, "Choose another file, or remove this one.") from error


MAX_ROWS = 1_000


CREATED, DONE = 201, 200


class DatabaseKeys:
    """The methods of `Client.keys` on a database itself; lists return the newest 1,000.

    No key is required, and each change is recorded in the audit log. Every method raises
    ServiceError or InputError if the database fails or the request is invalid.
    """

    def __init__(self, database: str) -> None:
        self._database = database

    def create(
        self,
        name: str,
        scope: str,
        expires_s: int | None = None,
        quotas: access.Quotas = access.UNLIMITED,
    ) -> access.NewKey:
        """Create a key; the answer contains its token, which can never be read again."""
        fields = {"name": name, "scope": scope, "expires_s": expires_s, "quotas": quotas}
        with self._open() as store:
            made = make_key(store, read_fields(fields, access.KeyRequest))
            _note(store, "POST", "", made.key.id, CREATED)
        return made

    def create_first(self, name: str, file: Path) -> FirstKey:
        """Create an administrator's key in a file, unless an administrator has a valid key."""
        with self._open() as store:
            answer = make_first_key(store, name, file)
            if answer.made is not None:
                _note(store, "POST", "", answer.made.id, CREATED)
        return answer

    def get(self, key: int) -> access.ApiKey:
        """Return a key, without its secret."""
        with self._open() as store:
            return store.keys.find(key).key

    def limit(self, key: int, quotas: access.Quotas) -> access.ApiKey:
        """Set the quotas of a key from now on; its earlier campaigns stay, and count."""
        with self._open() as store:
            limited = store.keys.limit(key, quotas)
            _note(store, "POST", "/{key}/quotas", limited.id, DONE)
        return limited

    def list(self) -> Rows[access.ApiKey]:
        """Return keys, newest first, including those that are no longer valid."""
        with self._open() as store:
            page = store.keys.page(MAX_ROWS)
        return Rows(lambda: iter(page.items))

    def revoke(self, key: int) -> access.ApiKey:
        """Revoke a key permanently."""
        with self._open() as store:
            revoked = revoke_key(store, key)
            _note(store, "DELETE", "/{key}", revoked.id, DONE)
        return revoked

    def audit(self) -> Rows[access.AuditEntry]:
        """Return the lines of the audit log, newest first."""
        with self._open() as store:
            page = store.audit.page(MAX_ROWS)
        return Rows(lambda: iter(page.items))

    def _open(self) -> "closing[Store]":
        return closing(open_store(self._database, migrate=False))


def _note(store: Store, method: str, path: str, key: int, status: int) -> None:
    """Write a line of the audit log, as the API would have written it."""
    route = f"{PREFIX}/keys"
    change = access.Change("database", None, method, f"{route}{path}", f"{route}/{key}", "", status)
    store.audit.append(change)
