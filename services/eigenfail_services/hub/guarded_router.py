"""A ROUTER for those alone whose keys are let in, from their first message to their last."""

from collections.abc import Collection, Sequence
from typing import Any

import structlog
import zmq

from eigenfail.wire.messages import Goodbye, encode

WHO = "User-Id"
"""Under which ZeroMQ tells, with each message, what the door said of its sender."""

FINGERPRINT = 12
"""So many letters of a key, in hexadecimal digits, tell it in lists and logs."""

LEFT = encode(Goodbye("Its key is let in no more."))

log = structlog.get_logger()


class GuardedRouter(zmq.Socket[bytes]):
    """Hears and answers only whose key is still let in; of others it says that they have left.

    ZeroMQ looks at a key in the handshake alone, and has no way to end a connection. Who is not
    answered makes a new one after a while, and is refused then.

    Attributes:
        let_in: the keys, in hexadecimal digits.
        cut_off: the connections of others.
    """

    let_in: Collection[str]
    cut_off: set[bytes]

    def recv_multipart(self, flags: int = 0, *_: Any, **__: Any) -> list[bytes]:  # type: ignore[override]
        """One message; in its place a goodbye, if its sender is let in no more."""
        frames = super().recv_multipart(flags, copy=False)
        sender, key = frames[0].bytes, str(frames[-1].get(WHO))
        if key in self.let_in:
            self.cut_off.discard(sender)
            return [frame.bytes for frame in frames]
        if sender not in self.cut_off:
            self.cut_off.add(sender)
            log.warning("worker cut off", key=key[:FINGERPRINT])
        return [sender, LEFT]

    def send_multipart(self, parts: Sequence[bytes], flags: int = 0, **_: Any) -> None:  # type: ignore[override]
        """One message, unless it is for somebody who was cut off."""
        if parts[0] not in self.cut_off:
            super().send_multipart(parts, flags)
