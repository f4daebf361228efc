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
    """Bounds on the campaigns that are made with a key; null if there is none.

    Attributes:
        max_open: most campaigns at once that have not ended; queued and paused ones count.
        max_episodes: largest budget of one campaign. [episodes]
        max_episodes_per_day: most episodes in the campaigns of the last 24 hours, by their budgets;
            those that were left unrun when a campaign ended do not count.
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
"""What its holder sends: the key's id and 256 random bits in base64url."""


SECRET = re.compile(r"(?<=ef_)(\d+)_[\w-]{16,}", re.ASCII)
"""The same wherever it turns up, whole or cut."""


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
"""Of a key that ends by itself. [s]"""


class Scope(StrEnum):
    """Scope of a key; each scope includes the previous ones."""

    VIEWER = "viewer"
    RUNNER = "runner"
    ADMIN = "admin"

    def allows(self, needed: "Scope") -> bool:
        """Whether it is enough."""
        order = [*Scope]
        return order.index(self) >= order.index(needed)


class KeyState(StrEnum):
    """Whether a key opens anything, or why not."""

    VALID = "valid"
    EXPIRED = "expired"
    REVOKED = "revoked"


class ApiKey(msgspec.Struct, frozen=True):
    """A key without its secret, which is shown once and not stored.

    Attributes:
        id: number of the key, the first part of what its holder sends.
        name: user or program that the key is for.
        scope: what it allows: viewer reads, runner also starts and steers, admin does everything.
        created_ms: when it was made, in milliseconds since 1970.
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
        """Whether it opens anything at a moment."""
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
        scope: what it allows: viewer, runner or admin.
        expires_s: lifetime [s]; null: valid until revoked.
        quotas: quotas of the key.
    """

    name: Annotated[str, msgspec.Meta(min_length=1, max_length=100, pattern=r"^\S(.*\S)?$")]
    scope: Scope = Scope.VIEWER
    expires_s: Annotated[int, msgspec.Meta(ge=1, le=LONGEST_LIFE_S)] | None = None
    quotas: Quotas = UNLIMITED


PROXY_PREFIX = "proxy:"
"""What the names of users whom a proxy signs in begin with."""

RESERVED_NAMES = frozenset({"loopback", "network", "database"})
"""Names under which the service records what was done without a key."""


def check_key_name(name: str) -> None:
    """Refuse a key's name that is reserved for callers without a key, or not read as written.

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
        token: what its holder sends, `ef_<id>_<secret>`: shown this once, and never again.
    """

    key: ApiKey
    token: str

    def __repr__(self) -> str:
        """Without the secret."""
        return f"NewKey(key={self.key!r}, token={redact(self.token)!r})"

    def __rich_repr__(self) -> list[tuple[str, Any]]:
        """The same for those who print with colours."""
        return [("key", self.key), ("token", redact(self.token))]


class Change(msgspec.Struct, frozen=True):
    """A request that changed something, or tried to: a line of the audit log, before it is one."""

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
        at_ms: when it was answered, in milliseconds since 1970.
        who: the key's name; `loopback` or `network` if no key was required, `database` for
            what was done on the database itself; the system's user for the keys of workers.
        key: id of the key.
        method: method of the request.
        route: its address, with the names of what varies in braces.
        subject: what was made or changed, as an address.
        address: address from which the request came.
        status: status of the answer.
        details: fields that the request gave, with their values; without any that may hold a
            secret, and empty if there are none.
    """

    id: int
    at_ms: int


def redact(text: str) -> str:
    """A text in which no key can be read, nor the password of a database."""
    for secret, instead in HIDDEN:
        text = secret.sub(instead, text)
    return text
