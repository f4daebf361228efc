"""Messages over a byte pipe: four bytes of length, then the message."""

import os
import struct
from collections.abc import Iterator
from typing import BinaryIO

from eigenfail.errors import ProtocolError
from eigenfail.wire.messages import MAX_MESSAGE_BYTES, Message, encode

LENGTH = struct.Struct("<I")
CHUNK_BYTES = 1 << 20


def write_message(pipe: BinaryIO, message: Message) -> None:
    """Write one message and flush it.

    Raises:
        BrokenPipeError: the other end is closed.
    """
    data = encode(message)
    pipe.write(LENGTH.pack(len(data)) + data)
    pipe.flush()


class FrameBuffer:
    """Collects the bytes of a pipe as they arrive, and yields complete frames."""

    def __init__(self) -> None:
        self._bytes = bytearray()

    def read(self, descriptor: int) -> bool:
        """Read the bytes that have arrived; return False at the end of the pipe."""
        try:
            data = os.read(descriptor, CHUNK_BYTES)
        except BlockingIOError:
            return True
        self._bytes += data
        return bool(data)

    def frames(self) -> Iterator[bytes]:
        """Yield and remove the complete frames.

        Raises:
            ProtocolError: a frame claims to be larger than any message.
        """
        while len(self._bytes) >= LENGTH.size:
            (length,) = LENGTH.unpack_from(self._bytes)
            if length > MAX_MESSAGE_BYTES:
                raise ProtocolError(f"A frame of {length} bytes came from the child.")
            end = LENGTH.size + length
            if len(self._bytes) < end:
                return
            frame = bytes(self._bytes[LENGTH.size : end])
            del self._bytes[:end]
            yield frame
