"""Keys of hubs and workers as one line of text, for storing and copying.

They are Curve25519 keys of 32 bytes each, for ZeroMQ's CURVE. A worker key holds the worker's
secret and the hub's public key: its owner can connect to the hub, but cannot pose as the hub.
"""

import base64
import binascii
import re
from dataclasses import dataclass, field

import msgspec

from eigenfail.errors import InvalidValue

KEY_BYTES = 32
HANDSHAKE_MS = 10_000
"""How long each side waits for the other during the handshake. [ms]"""

WORKER_KEY_VARIABLE = "EIGENFAIL_WORKER_KEY_FILE"
"""Variable that names the file of a worker's key."""

MARK = "efw_"
HUB_MARK = "efh_"
NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,63}")
"""Name of a worker key; it is also the name of a file."""


class AllowedWorker(msgspec.Struct, frozen=True):
    """A worker key that a hub accepts.

    Attributes:
        key: beginning of its public part, as in the hub's log.
        made_ms: when it was created. [ms since 1970]
        until_ms: when it expires, if it does. [ms since 1970]
    """

    name: str
    key: str
    made_ms: int
    until_ms: int | None = None

    def is_valid(self, at_ms: int) -> bool:
        """Return whether the key is still valid at a moment."""
        return self.until_ms is None or at_ms < self.until_ms


class NewWorkerKey(msgspec.Struct, frozen=True):
    """A new worker key.

    Attributes:
        worker: the key as listed.
        new_hub: beginning of the hub's public key, if that was created at the same time.
    """

    worker: AllowedWorker
    new_hub: str = ""


class NewHubKey(msgspec.Struct, frozen=True):
    """A new hub key.

    Attributes:
        hub: its public part, as text for workers.
        key: beginning of its public part, as in lists and logs.
    """

    hub: str
    key: str


@dataclass(frozen=True)
class WorkerKey:
    """The key of a worker.

    Attributes:
        hub: the hub's public key.
        secret: the worker's secret key; it is left out of the key's repr.
    """

    hub: bytes
    secret: bytes = field(repr=False)

    def text(self) -> str:
        """Return the key as one line of text."""
        return MARK + encode_key(self.hub + self.secret)

    def following(self, hub: bytes) -> "WorkerKey":
        """Return the same worker's key for another hub, or for a new key of the same hub."""
        return WorkerKey(hub, self.secret)


def read_worker_key(text: str, where: str) -> WorkerKey:
    """Return the worker key that a text holds.

    Args:
        text: text of the key.
        where: source of the text, for the error.

    Raises:
        InvalidValue: the text is not a worker key.
    """
    # The mark tells a worker's key from a hub's, which has other bytes behind it.
    both = decode_key(text.removeprefix(MARK), 2 * KEY_BYTES) if text.startswith(MARK) else None
    if both is None:
        problem = "is not a worker key."
        raise InvalidValue(where, problem, "Create one with `eigenfail worker key create`.")
    return WorkerKey(both[:KEY_BYTES], both[KEY_BYTES:])


def format_hub_key(public: bytes) -> str:
    """Return a hub's public key as text for workers."""
    return HUB_MARK + encode_key(public)


def read_hub_key(text: str, where: str) -> bytes:
    """Return the hub's public key that a text holds.

    Args:
        text: text of the key.
        where: source of the text, for the error.

    Raises:
        InvalidValue: the text is not a hub's public key.
    """
    public = decode_key(text.removeprefix(HUB_MARK), KEY_BYTES) if text[:4] == HUB_MARK else None
    if public is None:
        problem = "is not the public key of a hub."
        raise InvalidValue(where, problem, "`eigenfail worker key rotate-hub` prints it.")
    return public


def encode_key(key: bytes) -> str:
    """Return a key in URL-safe Base64, which needs no quotes in shells and files."""
    return base64.urlsafe_b64encode(key).rstrip(b"=").decode()


def decode_key(text: str, length: int) -> bytes | None:
    """Return the bytes of a key in URL-safe Base64; None if it is not a key of this length."""
    try:
        # `encode_key` left the padding to a multiple of four characters out.
        key = base64.b64decode(text + "=" * (-len(text) % 4), altchars=b"-_", validate=True)
    except (binascii.Error, ValueError):
        return None
    return key if len(key) == length else None


def abbreviate_key(public: bytes) -> str:
    """Return the beginning of a public key, its name in lists and logs."""
    return public.hex()[:12]
