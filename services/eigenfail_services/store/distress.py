"""Who cannot write to a database says so to all who use it, without writing anything.

What cannot be written cannot be noted in the database either. A lock can be held all the same:
everybody on the database sees it, and it is gone with the process that held it.
"""

import fcntl
import os
import time
from contextlib import suppress
from pathlib import Path
from threading import Lock, Timer
from typing import Protocol

from sqlalchemy import Connection, Engine, text
from sqlalchemy.exc import SQLAlchemyError

LASTS_S = 5.0
"""After the last write that failed; whoever has something to write tries again each second."""


class Signal(Protocol):
    """A lock that one process can hold, and that all on the database can see."""

    def hold(self) -> None:
        """Hold it, unless another process does."""

    def release(self) -> None:
        """Let go of it, if it is ours."""

    def is_held(self, connection: Connection) -> bool:
        """Whether any process holds it."""


class FolderLock:
    """For those who share a file: they are on one machine."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._handle: int | None = None

    def hold(self) -> None:
        """Lock the folder: a file of our own might find no room in it."""
        if self._handle is not None:
            return
        with suppress(OSError):
            handle = os.open(self._folder, os.O_RDONLY)
            if locked(handle, fcntl.LOCK_EX):
                self._handle = handle
            else:
                os.close(handle)

    def release(self) -> None:
        """Closing gives it back."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None

    def is_held(self, _connection: Connection) -> bool:
        """Whether it could not be locked; those who look are not in each other's way."""
        handle = os.open(self._folder, os.O_RDONLY)
        try:
            return not locked(handle, fcntl.LOCK_SH)
        finally:
            os.close(handle)


def locked(handle: int, how: int) -> bool:
    """Whether a lock could be had at once; where the file system knows none, nobody holds one."""
    try:
        fcntl.flock(handle, how | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return how == fcntl.LOCK_SH
    return True


class AdvisoryLock:
    """For those who share a server."""

    KEY = "hashtext('eigenfail_distress')"
    HOLD = text(f"SELECT pg_try_advisory_lock({KEY})")
    LET_GO = text(f"SELECT pg_advisory_unlock({KEY})")
    LOOK = text(f"SELECT pg_try_advisory_xact_lock_shared({KEY})")
    PROBE = text("SELECT 1")

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._connection: Connection | None = None

    def hold(self) -> None:
        """For as long as a connection of its own lasts."""
        if self._lasts():
            return
        with suppress(SQLAlchemyError):
            connection = self._engine.connect()
            if connection.execute(self.HOLD).scalar_one():
                connection.commit()
                self._connection = connection
            else:
                connection.close()

    def _lasts(self) -> bool:
        """Whether it is ours still: a server that was started anew has forgotten it."""
        if self._connection is None:
            return False
        try:
            self._connection.execute(self.PROBE)
            self._connection.commit()
        except SQLAlchemyError:
            self._connection.close()
            self._connection = None
        return self._connection is not None

    def release(self) -> None:
        """At once: the end of a connection is noticed by the server in its own time."""
        if self._connection is not None:
            with suppress(SQLAlchemyError):
                self._connection.execute(self.LET_GO)
            self._connection.close()
            self._connection = None

    def is_held(self, connection: Connection) -> bool:
        """Whether it cannot be shared; what is shared ends with the transaction."""
        return not connection.execute(self.LOOK).scalar_one()


class Distress:
    """Says that this process cannot write, for five seconds after it last could not."""

    def __init__(self, signal: Signal) -> None:
        self._signal = signal
        self._lock = Lock()
        self._until_s = 0.0
        self._timer: Timer | None = None

    def call(self) -> None:
        """A write has failed."""
        with self._lock:
            self._signal.hold()
            self._until_s = time.monotonic() + LASTS_S
            if self._timer is None:
                self._wait(LASTS_S)

    def is_heard(self, connection: Connection) -> bool:
        """Whether a process on the database, this one or another, cannot write."""
        return self._signal.is_held(connection)

    def end(self) -> None:
        """Say nothing any more."""
        with self._lock:
            if self._timer is not None:
                self._timer.cancel()
            self._timer = None
            self._signal.release()

    def _wait(self, seconds: float) -> None:
        self._timer = Timer(seconds, self._lapse)
        self._timer.daemon = True
        self._timer.start()

    def _lapse(self) -> None:
        with self._lock:
            left_s = self._until_s - time.monotonic()
            if self._timer is None:  # it came to its end while we waited
                return
            if left_s > 0.0:
                self._wait(left_s)
                return
            self._timer = None
            self._signal.release()
