"""Signatures of webhooks, after the Standard Webhooks specification (standardwebhooks.com, 1.0.0).

The specification's own library brings an HTTP client, attrs and three further packages; these
functions implement its HMAC.
"""

import hmac
import secrets
from base64 import b64decode, b64encode
from collections.abc import Mapping
from hashlib import sha256
from time import time

from eigenfail.errors import InvalidValue

ID_HEADER = "webhook-id"
TIMESTAMP_HEADER = "webhook-timestamp"
SIGNATURE_HEADER = "webhook-signature"

PREFIX = "whsec_"
SCHEME = "v1"
SECRET_BYTES = 32
"""The specification asks for 24 to 64 random bytes."""

TOLERANCE_S = 300.0
"""Age beyond which a message may be one that was recorded and is sent again."""


def make_secret() -> str:
    """Return a new secret: `whsec_` and 32 random bytes in base64."""
    return PREFIX + b64encode(secrets.token_bytes(SECRET_BYTES)).decode()


def sign_message(secret: str, message: str, at_s: int, body: bytes) -> str:
    """Return the signature of a message: `v1,` and the base64 of an HMAC-SHA256.

    Args:
        secret: `whsec_` and the base64 of the key.
        message: its id, the header `webhook-id`.
        at_s: the header `webhook-timestamp`, in seconds since 1970.
        body: the body, as sent.

    Raises:
        InvalidValue: the secret is not of that form.
    """
    signed = f"{message}.{at_s}.".encode() + body
    digest = hmac.digest(_decode_secret(secret), signed, sha256)
    return f"{SCHEME},{b64encode(digest).decode()}"


def verify_message(
    secret: str, headers: Mapping[str, str], body: bytes, now_s: float | None = None
) -> None:
    """Check that a message was signed with a secret within five minutes of now.

    Args:
        secret: the secret that was shown when the webhook was created.
        headers: headers of the request, with names in lower case.
        body: its body, as it was received.
        now_s: current time, in seconds since 1970; None reads the clock.

    Raises:
        InvalidValue: the message is unsigned, altered, too old, or of the future.
    """
    message, at, given = (
        headers.get(name, "") for name in (ID_HEADER, TIMESTAMP_HEADER, SIGNATURE_HEADER)
    )
    if not (message and at.isascii() and at.isdecimal() and len(at) <= 12):
        raise InvalidValue(TIMESTAMP_HEADER, "the message has no id or no valid time.")
    if abs((time() if now_s is None else now_s) - int(at)) > TOLERANCE_S:
        raise InvalidValue(TIMESTAMP_HEADER, f"the message is not within {TOLERANCE_S:g} s of now.")
    right = sign_message(secret, message, int(at), body).encode()
    # While a secret is replaced, a sender may sign with both: one signature that fits is enough.
    if not any(hmac.compare_digest(right, each.encode()) for each in given.split(" ")):
        raise InvalidValue(SIGNATURE_HEADER, "no signature of the message fits the secret.")


def _decode_secret(secret: str) -> bytes:
    try:
        key = b64decode(secret.removeprefix(PREFIX), validate=True)
    except ValueError:
        key = b""
    if not key:
        # The secret itself is not repeated.
        raise InvalidValue("secret", "the value is not of the form whsec_BASE64.")
    return key
