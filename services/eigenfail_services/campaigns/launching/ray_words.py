"""What the services and their Ray process say to each other: a line of JSON each.

Ray's driver ends its whole process when the cluster's head stays away for a minute, and may wait
that long in any call. So it has a process of its own, which can be killed and started anew.
"""

import os
from collections.abc import Iterator
from typing import Generic, TypeVar

import msgspec

CHUNK = 65_536

Word = TypeVar("Word")


class Begin(msgspec.Struct, frozen=True):
    """Services: connect to Ray, and have workers serve this hub.

    Attributes:
        hub: its address.
        key: what workers show it, as it is carried; none if it asks for none.
        cluster: address of a running Ray; none: start one on this machine.
        most: workers that there is to be room for on a Ray of one machine.
    """

    hub: str
    key: str | None
    cluster: str | None
    most: int


class Wanted(msgspec.Struct, frozen=True):
    """Services: these workers are to be there, and no others that nobody placed yet."""

    names: tuple[str, ...]


class Standing(msgspec.Struct, frozen=True, tag=True):
    """Ray process: it is well, and so it stands.

    Attributes:
        machines: of the cluster that live.
        placed: workers for which Ray has found a place.
        unplaced: that were asked of it, and have none.
        refused: why some ended for good, which ought to be there.
    """

    machines: int = 0
    placed: tuple[str, ...] = ()
    unplaced: tuple[str, ...] = ()
    refused: dict[str, str] = {}


class Lost(msgspec.Struct, frozen=True, tag=True):
    """Ray process: Ray cannot be used, or not any more, and why; I end."""

    problem: str
    remedy: str = ""


class Lines(Generic[Word]):
    """What comes over a pipe, line by line, without waiting for it.

    Args:
        descriptor: the end to read from.
        decoder: of what is said there.

    Attributes:
        ended: whether nothing more can come.
    """

    def __init__(self, descriptor: int, decoder: msgspec.json.Decoder[Word]) -> None:
        os.set_blocking(descriptor, False)
        self._descriptor = descriptor
        self._decoder = decoder
        self._begun = b""
        self.ended = False

    def read(self) -> Iterator[Word]:
        """Every whole line that is there.

        Raises:
            msgspec.DecodeError: it is none of these.
        """
        *lines, self._begun = (self._begun + b"".join(self._chunks())).split(b"\n")
        for line in lines:
            yield self._decoder.decode(line)

    def _chunks(self) -> Iterator[bytes]:
        try:
            while chunk := os.read(self._descriptor, CHUNK):
                yield chunk
            self.ended = True
        except BlockingIOError:
            return


def line(word: msgspec.Struct) -> bytes:
    """As it is written."""
    return msgspec.json.encode(word) + b"\n"
