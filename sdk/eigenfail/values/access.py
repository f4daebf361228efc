"""Keys: who may do what; and the audit log: who did what."""

import re
import unicodedata
from enum import StrEnum
from typing import Annotated, Any

import msgspec

from eigenfail.errors import InvalidValue, is_unsafe

MOST = 10**15


Limit = Annotated[int, msgspec.Meta(ge=0, le=MOST)] | None


class Quotas(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Limits on the campaigns made with a key; null: unlimited.

    Attributes:
        max_open: maximum number of campaigns that have not ended, including queued and paused ones.
        max_episodes: largest budget of one campaign. [episodes]
        max_episodes_per_day: maximum number of episodes in the campaigns of the last 24 hours, by
            their budgets. Episodes left unrun when a campaign ended do not count.
    """

    max_open: Limit = None
    max_episodes: Limit = None
    max_episodes_per_day: Limit = None


UNLIMITED = Quotas()


class Usage(msgspec.Struct, frozen=True):
    """The usage of a key's quotas.

    Attributes:
        open: campaigns that have not ended.
        episodes_of_day: number of episodes in the campaigns of the last 24 hours.
    """

    open: int = 0
    episodes_of_day: int = 0


TOKEN = re.compile(r"ef_(?P<id>[1-9]\d{0,17})_(?P<secret>[\w-]{43})", re.ASCII)
"""Pattern of a token: the key's id and 256 random bits in base64url."""


SECRET = re.compile(r"(?<=ef_)(\d+)_[\w-]{16,}", re.ASCII)
"""Pattern of a token anywhere in a text, whole or cut off."""


HIDDEN = (
    (SECRET, r"\1_…"),
    # The key of a worker, with a CURVE secret in it.
    (re.compile(r"(?<=efw_)[\w-]{16,}", re.ASCII), "…"),
    # The secret of a webhook.
    (re.compile(r"(?<=whsec_)[\w+/=-]{16,}", re.ASCII), "…"),
    # The password in the URL of a database, and among the words of a connection.
    (
        re.compile(
            r"(?<=://)([^\s:/@\"']*):(?!\d+[/?#])"  # a port ends there, no password does
            r"(?:[^\s@\"']|[\"'](?![,:}\])\s]))+@"  # a quote in it does not end a text
        ),
        r"\1:…@",
    ),
    (
        re.compile(
            r"(?im)(password\\*[\"']?[ \t]*[=:][ \t]*)(?!None\b)"
            r"(?:(\\*[\"'])(?:\\.|(?!\2)[^\\\n])*?(?:\2|$)|[^\s&\"',)]+)"
        ),
        r"\1\2…\2",
    ),
)
"""Patterns of secrets in texts, with their replacements."""


LONGEST_LIFE_S = 10 * 366 * 86_400
"""Longest lifetime of a key that expires. [s]"""


class Scope(StrEnum):
    """Scope of a key; each scope includes the previous ones."""

    VIEWER = "viewer"
    RUNNER = "runner"
    ADMIN = "admin"

    def allows(self, needed: "Scope") -> bool:
        """Return whether this scope includes the needed one."""
        order = [*Scope]
        return order.index(self) >= order.index(needed)


class KeyState(StrEnum):
    """State of a key: valid, or the reason why it is refused."""

    VALID = "valid"
    EXPIRED = "expired"
    REVOKED = "revoked"


class ApiKey(msgspec.Struct, frozen=True):
    """A key without its secret, which is shown once and not stored.

    Attributes:
        id: number of the key, the first part of its token.
        name: user or program that the key is for.
        scope: viewer reads, runner also starts and steers campaigns, admin does everything.
        created_ms: when it was created, in milliseconds since 1970.
        expires_ms: time of expiry; null if the key does not expire.
        revoked_ms: when it was revoked.
        last_used_ms: when it was last used, to the minute.
        quotas: quotas of the key.
    """

    id: int
    name: str
    scope: Scope
    created_ms: int
    expires_ms: int | None = None
    revoked_ms: int | None = None
    last_used_ms: int | None = None
    quotas: Quotas = UNLIMITED

    def is_valid(self, at_ms: int) -> bool:
        """Return whether the key is valid at a moment."""
        return self.find_state(at_ms) is KeyState.VALID

    def find_state(self, at_ms: int) -> KeyState:
        """Return the state of the key at a moment."""
        # A key that was revoked may have expired since.
        if self.revoked_ms is not None:
            return KeyState.REVOKED
        is_over = self.expires_ms is not None and self.expires_ms <= at_ms
        return KeyState.EXPIRED if is_over else KeyState.VALID


class KeyRecord(msgspec.Struct, frozen=True):
    """A key as stored: with the SHA-256 of its secret, in hexadecimal digits."""

    key: ApiKey
    digest: str


class KeyRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Settings of a new key.

    Attributes:
        name: user or program that the key is for.
        scope: viewer, runner or admin.
        expires_s: lifetime [s]; null: valid until revoked.
        quotas: quotas of the key.
    """

    name: Annotated[str, msgspec.Meta(min_length=1, max_length=100, pattern=r"^\S(.*\S)?$")]
    scope: Scope = Scope.VIEWER
    expires_s: Annotated[int, msgspec.Meta(ge=1, le=LONGEST_LIFE_S)] | None = None
    quotas: Quotas = UNLIMITED


PROXY_PREFIX = "proxy:"
"""Prefix of the names of users whom a proxy signs in."""

RESERVED_NAMES = frozenset({"loopback", "network", "database"})
"""Names under which the service records what was done without a key."""


def check_key_name(name: str) -> None:
    """Refuse a name that is reserved for callers without a key, or has invisible characters.

    Raises:
        InvalidValue: the name is reserved in any spelling, or has a control or invisible character.
    """
    if any(map(is_unsafe, name)):
        raise InvalidValue(
            "name", "contains a control character or an invisible one.", "Take it out."
        )
    letters = unicodedata.normalize("NFKC", name)
    plain = "".join(each for each in letters if each.isprintable()).casefold().strip()
    if plain in RESERVED_NAMES or plain.startswith(PROXY_PREFIX):
        raise InvalidValue(
            "name",
            "it is reserved for callers without a key.",
            "Choose a name other than loopback, network and database that does not begin with "
            "proxy:",
        )


class NewKey(msgspec.Struct, frozen=True):
    """A newly created key with its secret.

    Attributes:
        key: the stored key; the secret itself is not stored.
        token: text that its holder sends, `ef_<id>_<secret>`; shown only once.
    """

    key: ApiKey
    token: str

    def __repr__(self) -> str:
        """Return the representation with the secret hidden."""
        return f"NewKey(key={self.key!r}, token={redact(self.token)!r})"

    def __rich_repr__(self) -> list[tuple[str, Any]]:
        """Return the fields for printing in colour, with the secret hidden."""
        return [("key", self.key), ("token", redact(self.token))]


class Change(msgspec.Struct, frozen=True):
    """A request that changed something, or tried to, before the audit log records it."""

    who: str
    key: int | None
    method: str
    route: str
    subject: str
    address: str
    status: int
    details: str = ""


class AuditEntry(Change, frozen=True, kw_only=True):
    """A line of the audit log: who did what, when, from where, and how it ended.

    Attributes:
        id: number of the line.
        at_ms: when the request was answered, in milliseconds since 1970.
        who: the key's name; `loopback` or `network` if no key was required; `database` for
            changes made in the database itself; the system's user for the keys of workers.
        key: id of the key.
        method: method of the request.
        route: address of the request, with the names of its variable parts in braces.
        subject: the object made or changed, as an address.
        address: network address of the caller.
        status: status of the answer.
        details: fields of the request with their values, without fields that may hold a secret;
            empty if there are none.
    """

    id: int
    at_ms: int


def redact(text: str) -> str:
    """Return the text with keys, webhook secrets and database passwords hidden."""
    for secret, instead in HIDDEN:
        text = secret.sub(instead, text)
    return text
