"""Messages between the services and their Ray process: a line of JSON each.

Ray's driver ends its whole process when the cluster's head stays away for a minute, and may wait
that long in any call. So the driver runs in a separate process, which can be killed and restarted.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Generic, TypeVar

import msgspec
from msgspec.structs import replace

from eigenfail.processes import as_parent, exit_status, kill_group
from eigenfail_services.hub.metrics import Timeout

CHUNK = 65_536


Message = TypeVar("Message")


class StartRay(msgspec.Struct, frozen=True):
    """Services: connect to Ray, and have workers serve this hub.

    Attributes:
        hub: its address.
        key: the key that workers present, in its encoded form; none if none is required.
        cluster: address of a running Ray; none: start one on this machine.
        most: number of workers for which a Ray of one machine needs room.
        folder: temporary folder of a Ray of one machine; its creator removes it.
    """

    hub: str
    key: str | None
    cluster: str | None
    most: int
    folder: str = ""


class WantedWorkers(msgspec.Struct, frozen=True):
    """Services: keep these workers, and no others that are not yet placed."""

    names: tuple[str, ...]


class ClusterStatus(msgspec.Struct, frozen=True, tag=True):
    """Ray process: the status of cluster and workers.

    Attributes:
        machines: number of live machines in the cluster.
        placed: workers for which Ray has found a place.
        unplaced: requested workers that still lack a place.
        refused: reasons why wanted workers ended for good, by name.
    """

    machines: int = 0
    placed: tuple[str, ...] = ()
    unplaced: tuple[str, ...] = ()
    refused: dict[str, str] = {}


class ClusterLost(msgspec.Struct, frozen=True, tag=True):
    """Ray process: Ray cannot be used (any more), and why; the process ends."""

    problem: str
    remedy: str = ""


class PipeReader(Generic[Message]):
    """Reads messages from a pipe, line by line, without waiting.

    Args:
        descriptor: the end to read from.
        decoder: decoder of the messages on it.

    Attributes:
        ended: whether nothing more can come.
    """

    def __init__(self, descriptor: int, decoder: msgspec.json.Decoder[Message]) -> None:
        os.set_blocking(descriptor, False)
        self._descriptor = descriptor
        self._decoder = decoder
        self._begun = b""
        self.ended = False

    def read(self) -> Iterator[Message]:
        """Yield the messages that have arrived.

        Raises:
            msgspec.DecodeError: a line is not a valid message.
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


def encode_line(word: msgspec.Struct) -> bytes:
    """Return a message as a line of JSON."""
    return msgspec.json.encode(word) + b"\n"


MODULE = "eigenfail_services.campaigns.ray_process"


BEGIN_WITHIN_S = 120.0


SILENCE_LIMIT_S = 30.0
"""Ray's own timeout with a head that does not answer is twice as long."""


# Longer than the driver itself waits for its workers to leave, which is 3 s.
PARTING_S = 8.0


LOOK_EVERY_S = 0.02


REMOVAL_S = 2.0
"""Processes of a Ray that was killed may write a last file while their folder is removed."""


Word = ClusterStatus | ClusterLost


class RayLink:
    """A running Ray process, from its start to its end.

    Raises:
        OSError: the system lacks the resources for it.
    """

    def __init__(self, begin: StartRay) -> None:
        # The driver may be killed at any moment, so this process removes the folder of its Ray.
        self._folder = "" if begin.cluster else create_ray_folder()
        try:
            self._process = _start_driver()
        except OSError:
            self._remove_folder()
            raise
        if self._process.stdin is None or self._process.stdout is None:
            raise RuntimeError("pipes were asked for")
        self._wishes, self._words = self._process.stdin, self._process.stdout
        with suppress(OSError):  # it ended at once: `trouble` says why
            self._wishes.write(encode_line(replace(begin, folder=self._folder)))
        # The first message is written as a whole. From then on, a driver that hangs in a call of
        # Ray must not hold up the services.
        os.set_blocking(self._wishes.fileno(), False)
        self._lines = PipeReader(self._words.fileno(), msgspec.json.Decoder(Word))
        self._timeout = Timeout(BEGIN_WITHIN_S)
        self._wanted: tuple[str, ...] | None = None
        self._unsent = b""

    def want(self, names: tuple[str, ...]) -> None:
        """Send the wanted workers if they changed; a message without room is sent later."""
        if not self._unsent and names != self._wanted:
            self._unsent, self._wanted = encode_line(WantedWorkers(names)), names
        with suppress(OSError):  # it ends, or does not read: then it is started anew
            # A full pipe accepts a part of the message, or nothing (None): the rest is sent in a
            # later turn.
            self._unsent = self._unsent[self._wishes.write(self._unsent) or 0 :]

    def hear(self) -> Iterator[Word]:
        """Yield the messages of the Ray process that have arrived."""
        for word in self._lines.read():
            # Connecting to Ray may take two minutes; a driver that has reported once reports every
            # half second.
            self._timeout = Timeout(SILENCE_LIMIT_S)
            yield word

    def trouble(self) -> str:
        """Return why the Ray process is lost; empty while it works."""
        if (status := exit_status(self._process)) is not None:
            return f"The process of Ray's driver ended with status {status}."
        return "Ray does not answer." if self._timeout.has_expired() else ""

    def stop(self) -> None:
        """End it in order, or by force if that takes long."""
        with suppress(OSError):
            self._wishes.close()
        until_s = time.monotonic() + PARTING_S
        while exit_status(self._process) is None and time.monotonic() < until_s:
            self._drain()
            time.sleep(LOOK_EVERY_S)
        self.kill()

    def kill(self) -> None:
        """End it now, and with it a Ray that it started, whose folder is removed."""
        kill_group(self._process)
        self._words.close()
        with suppress(OSError):
            self._wishes.close()
        self._remove_folder()

    def _remove_folder(self) -> None:
        """Remove the folder of a Ray of one machine, as far as that is possible within 2 s."""
        until_s = time.monotonic() + REMOVAL_S
        while self._folder and Path(self._folder).exists() and time.monotonic() < until_s:
            shutil.rmtree(self._folder, ignore_errors=True)
            time.sleep(LOOK_EVERY_S)

    def _drain(self) -> None:
        """Read and drop its messages, so that its writes never block."""
        with suppress(msgspec.DecodeError):
            for _ in self._lines.read():
                pass


def create_ray_folder() -> str:
    """Create the temporary folder of one Ray, for its owner alone.

    Its name is short, since Ray puts sockets below it, and their paths have 107 bytes at most.

    Raises:
        OSError: the folder cannot be created.
    """
    return tempfile.mkdtemp(prefix="ray-", dir=os.environ.get("RAY_TMPDIR"))


def _start_driver() -> "subprocess.Popen[bytes]":
    """Start the process of Ray's driver, as the leader of a process group.

    Raises:
        OSError: the system lacks the resources for it.
    """
    # The pipes have no buffer: `PipeReader` reads the descriptor itself, and would miss what a
    # buffer holds.
    return subprocess.Popen(
        [sys.executable, "-m", MODULE],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        bufsize=0,
        env=os.environ | as_parent(),
        process_group=0,
    )
