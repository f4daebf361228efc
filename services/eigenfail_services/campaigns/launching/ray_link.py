"""The services' handle on their Ray process."""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress

import msgspec

from eigenfail.processes import as_parent, exit_status, kill_group
from eigenfail_services.campaigns.launching.ray_words import (
    Begin,
    Lines,
    Lost,
    Standing,
    Wanted,
    line,
)
from eigenfail_services.hub.patience import Patience

MODULE = "eigenfail_services.campaigns.launching.ray_process"
BEGIN_WITHIN_S = 120.0
SILENCE_LIMIT_S = 30.0
"""Ray's own patience with a head that does not answer is twice as long."""

PARTING_S = 8.0
LOOK_EVERY_S = 0.02

Word = Standing | Lost


class RayLink:
    """One life of a Ray process.

    Raises:
        OSError: the system has no room for it.
    """

    def __init__(self, begin: Begin) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", MODULE],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            bufsize=0,
            env=os.environ | as_parent(),
            process_group=0,
        )
        if self._process.stdin is None or self._process.stdout is None:
            raise RuntimeError("pipes were asked for")
        self._wishes, self._words = self._process.stdin, self._process.stdout
        with suppress(OSError):  # it ended at once: `trouble` tells
            self._wishes.write(line(begin))
        os.set_blocking(self._wishes.fileno(), False)
        self._lines = Lines(self._words.fileno(), msgspec.json.Decoder(Word))
        self._patience = Patience(BEGIN_WITHIN_S)
        self._wanted: tuple[str, ...] | None = None
        self._unsent = b""

    def want(self, names: tuple[str, ...]) -> None:
        """Tell it whom it is to have, if that is new; never waits: what has no room goes later."""
        if not self._unsent and names != self._wanted:
            self._unsent, self._wanted = line(Wanted(names)), names
        with suppress(OSError):  # it ends, or does not read: then it is started anew
            self._unsent = self._unsent[self._wishes.write(self._unsent) or 0 :]

    def hear(self) -> Iterator[Word]:
        """All that it has said."""
        for word in self._lines.read():
            self._patience = Patience(SILENCE_LIMIT_S)
            yield word

    def trouble(self) -> str:
        """Why nothing is to be expected of it any more; empty as long as something is."""
        if (status := exit_status(self._process)) is not None:
            return f"The process of Ray's driver ended with status {status}."
        return "Ray does not answer." if self._patience.is_over() else ""

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
        """End it now, and with it a Ray that it started."""
        kill_group(self._process)
        self._words.close()
        with suppress(OSError):
            self._wishes.close()

    def _drain(self) -> None:
        """So that it never waits for us."""
        with suppress(msgspec.DecodeError):
            for _ in self._lines.read():
                pass
