"""Keys: made, and held against what somebody shows.

A secret is 256 random bits, so its SHA-256 tells nothing of it, and nobody can try them all.
"""

import hashlib
import hmac
import secrets

from eigenfail.errors import Conflict, InvalidValue, NotFound, Unauthorized
from eigenfail.values.access import TOKEN, ApiKey, KeyRequest, NewKey, Scope
from eigenfail_services.store import Store
from eigenfail_services.store.clock import now_ms

SECRET_BYTES = 32
MINUTE_MS = 60_000


def make_key(store: Store, request: KeyRequest) -> NewKey:
    """A new key, with what its holder sends: nobody can tell it again.

    Raises:
        InvalidValue: it would be the first one, and not an administrator's.
    """
    at_ms = now_ms()
    if request.scope is not Scope.ADMIN and not store.keys.admins(at_ms):
        raise InvalidValue(
            "scope",
            "no administrator has a valid key yet, and from the first key on everybody needs one.",
            "Make a key with the scope admin first.",
        )
    secret = secrets.token_urlsafe(SECRET_BYTES)
    expires_ms = None if request.expires_s is None else at_ms + 1_000 * request.expires_s
    key = store.keys.create(request.name, request.scope, digest(secret), expires_ms, request.quotas)
    return NewKey(key, f"ef_{key.id}_{secret}")


def revoke_key(store: Store, number: int) -> ApiKey:
    """The key, which opens nothing any more.

    Raises:
        NotFound: there is no such key.
        Conflict: without it no administrator could come in, and nobody could make another.
    """
    at_ms, key = now_ms(), store.keys.find(number).key
    is_admin = key.scope is Scope.ADMIN and key.is_valid(at_ms)
    if is_admin and store.keys.admins(at_ms) == 1:
        raise Conflict(
            f"Key {number} is the last of an administrator: without it nobody could make keys.",
            "Make another administrator's key first, then revoke this one.",
        )
    return store.keys.revoke(number)


def shown_key(store: Store, token: str, at_ms: int) -> ApiKey:
    """The key that somebody shows, if it is valid at a moment.

    Raises:
        Unauthorized: it is none, or not any more; in the same words whatever the reason.
    """
    match = TOKEN.fullmatch(token)
    if match is None:
        raise no_valid_key()
    try:
        found = store.keys.find(int(match["id"]))
    except NotFound:
        raise no_valid_key() from None
    if not hmac.compare_digest(digest(match["secret"]), found.digest):
        raise no_valid_key()
    return valid(found.key, at_ms)


def valid(key: ApiKey, at_ms: int) -> ApiKey:
    """The key, if it is valid at a moment.

    Raises:
        Unauthorized: it is not.
    """
    if not key.is_valid(at_ms):
        raise no_valid_key()
    return key


def note_use(store: Store, key: ApiKey, at_ms: int) -> None:
    """Write down that a key is in use, at most once a minute."""
    if key.last_used_ms is None or at_ms - key.last_used_ms >= MINUTE_MS:
        store.keys.used(key.id, at_ms)


def digest(secret: str) -> str:
    """What is kept of a secret: its SHA-256, in hexadecimal digits."""
    return hashlib.sha256(secret.encode()).hexdigest()


def no_valid_key() -> Unauthorized:
    """The one refusal of whoever shows no key, or one that opens nothing."""
    return Unauthorized(
        "This service answers only those who show a valid key.",
        "Send `Authorization: Bearer ef_…`: set EIGENFAIL_KEY, or sign in at /login. "
        "`eigenfail key create` makes keys.",
    )
