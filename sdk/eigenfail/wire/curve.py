"""Keys between hub and workers, as they are carried and kept: one line of text.

They are CURVE's (Curve25519), of 32 bytes each. What a worker holds lets it in and tells it who the
hub is; it does not let anybody be the hub.
"""

import base64
import binascii
import re
from dataclasses import dataclass, field

import msgspec

from eigenfail.errors import InvalidValue

KEY_BYTES = 32
HANDSHAKE_MS = 10_000
"""For how long either side waits for the other one's part."""

MARK = "efw_"
HUB_MARK = "efh_"
NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,63}")
"""Of a worker's key; it is the name of a file, too."""


class AllowedWorker(msgspec.Struct, frozen=True):
    """A worker's key that a hub lets in.

    Attributes:
        key: the beginning of its public part, as the hub's log tells it.
        made_ms: milliseconds since 1970.
        until_ms: when it ends; None if it does not.
    """

    name: str
    key: str
    made_ms: int
    until_ms: int | None = None

    def is_valid(self, at_ms: int) -> bool:
        """Whether it is let in at a moment."""
        return self.until_ms is None or at_ms < self.until_ms


class NewWorkerKey(msgspec.Struct, frozen=True):
    """A key that was just made.

    Attributes:
        worker: whom it lets in.
        new_hub: the beginning of the hub's public key, if that was made just now, too.
    """

    worker: AllowedWorker
    new_hub: str = ""


class NewHubKey(msgspec.Struct, frozen=True):
    """The hub's key that was just made.

    Attributes:
        hub: its public part, as workers are told of it.
        key: the beginning of it, as lists and logs tell it.
    """

    hub: str
    key: str


@dataclass(frozen=True)
class WorkerKey:
    """What a worker shows, and by what it knows the hub.

    Attributes:
        hub: the hub's public key.
        secret: the worker's own; what is printed of a key does not show it.
    """

    hub: bytes
    secret: bytes = field(repr=False)

    def text(self) -> str:
        """As it is carried."""
        return MARK + to_text(self.hub + self.secret)

    def following(self, hub: bytes) -> "WorkerKey":
        """The same worker's, for another hub, or the same one with a new key."""
        return WorkerKey(hub, self.secret)


def read_worker_key(text: str, where: str) -> WorkerKey:
    """The key that a text is.

    Raises:
        InvalidValue: it is none.
    """
    both = from_text(text.removeprefix(MARK), 2 * KEY_BYTES) if text.startswith(MARK) else None
    if both is None:
        problem = "what is there is no key of a worker."
        raise InvalidValue(where, problem, "`eigenfail worker key create` makes one.")
    return WorkerKey(both[:KEY_BYTES], both[KEY_BYTES:])


def hub_text(public: bytes) -> str:
    """A hub's public key, as workers are told of it."""
    return HUB_MARK + to_text(public)


def read_hub_key(text: str, where: str) -> bytes:
    """The hub's public key that a text is.

    Raises:
        InvalidValue: it is none.
    """
    public = from_text(text.removeprefix(HUB_MARK), KEY_BYTES) if text[:4] == HUB_MARK else None
    if public is None:
        problem = "that is no public key of a hub."
        raise InvalidValue(where, problem, "`eigenfail worker key rotate-hub` tells it.")
    return public


def to_text(key: bytes) -> str:
    """A key in letters that need no quotes anywhere."""
    return base64.urlsafe_b64encode(key).rstrip(b"=").decode()


def from_text(text: str, length: int) -> bytes | None:
    """The bytes that a text stands for; None if it is not so many bytes in such letters."""
    try:
        key = base64.b64decode(text + "=" * (-len(text) % 4), altchars=b"-_", validate=True)
    except (binascii.Error, ValueError):
        return None
    return key if len(key) == length else None


def fingerprint(public: bytes) -> str:
    """By what a public key is told in lists and logs."""
    return public.hex()[:12]
