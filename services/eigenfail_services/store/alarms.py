"""Alarms of processes that cannot write to a database, for all others that use it.

Such a process cannot write its alarm into the database. It can hold a lock, which every process on
the database sees, and which is released when the process ends.
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
"""Time after the last failed write; writers try again each second."""


class Signal(Protocol):
    """A lock that one process can hold, and that all on the database can see."""

    def hold(self) -> None:
        """Hold the lock, unless another process does."""

    def release(self) -> None:
        """Release the lock, if this process holds it."""

    def is_held(self, connection: Connection) -> bool:
        """Return whether any process holds the lock."""


class FolderLock:
    """The lock of a database file: a lock on its folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._handle: int | None = None

    def hold(self) -> None:
        """Lock the folder; a separate lock file might not fit on a full disk."""
        if self._handle is not None:
            return
        # If the folder cannot be locked, the alarm stays silent. The write that failed is reported
        # anyway.
        with suppress(OSError):
            handle = os.open(self._folder, os.O_RDONLY)
            if _try_lock(handle, fcntl.LOCK_EX):
                self._handle = handle
            else:
                os.close(handle)

    def release(self) -> None:
        """Close the folder, which releases the lock."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None

    def is_held(self, _connection: Connection) -> bool:
        """Return whether the folder is locked; readers of the lock do not block each other."""
        handle = os.open(self._folder, os.O_RDONLY)
        try:
            return not _try_lock(handle, fcntl.LOCK_SH)
        finally:
            os.close(handle)


class ProcessFlag:
    """The flag of a database in memory, which one process uses."""

    def __init__(self) -> None:
        self._held = False

    def hold(self) -> None:
        """Raise the flag."""
        self._held = True

    def release(self) -> None:
        """Lower the flag."""
        self._held = False

    def is_held(self, _connection: Connection) -> bool:
        """Return whether the flag is up."""
        return self._held


def _try_lock(handle: int, how: int) -> bool:
    """Return whether a lock was taken at once; without file locks, only a shared one is."""
    try:
        fcntl.flock(handle, how | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return how == fcntl.LOCK_SH
    return True


class AdvisoryLock:
    """The lock of a database server."""

    KEY = "hashtext('eigenfail_distress')"
    # The lock belongs to a session. It outlasts the transaction that failed, and the server
    # releases it if this process dies.
    HOLD = text(f"SELECT pg_try_advisory_lock({KEY})")
    LET_GO = text(f"SELECT pg_advisory_unlock({KEY})")
    # Several processes may look at the same time: a shared lock does not make one of them take
    # another one for the holder.
    LOOK = text(f"SELECT pg_try_advisory_xact_lock_shared({KEY})")
    PROBE = text("SELECT 1")

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._connection: Connection | None = None

    def hold(self) -> None:
        """Hold the lock while a dedicated connection lasts."""
        if self._lasts():
            return
        with suppress(SQLAlchemyError):
            connection = self._engine.connect()
            if connection.execute(self.HOLD).scalar_one():
                # The lock stays with the session; the transaction need not stand idle meanwhile.
                connection.commit()
                self._connection = connection
            else:
                connection.close()

    def _lasts(self) -> bool:
        """Return whether the lock is still held: a server that restarted has forgotten it."""
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
        """Unlock explicitly: the server notices the end of a connection in its own time."""
        if self._connection is not None:
            with suppress(SQLAlchemyError):
                self._connection.execute(self.LET_GO)
            self._connection.close()
            self._connection = None

    def is_held(self, connection: Connection) -> bool:
        """Return whether the lock cannot be shared; sharing ends with the transaction."""
        return not connection.execute(self.LOOK).scalar_one()


class WriteAlarm:
    """Signals that this process cannot write, until five seconds after its last failed write."""

    def __init__(self, signal: Signal) -> None:
        self._signal = signal
        self._lock = Lock()
        self._until_s = 0.0
        self._timer: Timer | None = None

    def begin(self) -> None:
        """Begin or prolong the alarm, after a write has failed."""
        with self._lock:
            self._signal.hold()
            self._until_s = time.monotonic() + LASTS_S
            if self._timer is None:
                self._wait(LASTS_S)

    def is_raised(self, connection: Connection) -> bool:
        """Return whether a process on the database, this one or another, cannot write."""
        return self._signal.is_held(connection)

    def end(self) -> None:
        """End the alarm at once."""
        with self._lock:
            if self._timer is not None:
                self._timer.cancel()
            self._timer = None
            self._signal.release()

    def _wait(self, seconds: float) -> None:
        self._timer = Timer(seconds, self._lapse)
        # A process that ends must not wait for its own alarm.
        self._timer.daemon = True
        self._timer.start()

    def _lapse(self) -> None:
        with self._lock:
            left_s = self._until_s - time.monotonic()
            if self._timer is None:  # it came to its end while we waited
                return
            # A further failure only moves the end: one timer waits again, so that failures do not
            # add up to threads.
            if left_s > 0.0:
                self._wait(left_s)
                return
            self._timer = None
            self._signal.release()
