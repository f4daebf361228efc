"""The folder of a service on one machine: its database, its logs, and the lock of its service."""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

import msgspec

from eigenfail.addresses import sqlite_url
from eigenfail.errors import ServiceError, StoreUnavailable
from eigenfail.files import make_private_folder, open_private

HOST = "127.0.0.1"
PORT = 8440
DEFAULT_URL = f"http://{HOST}:{PORT}"
DEFAULT_DATA = Path("eigenfail-data")


class Address(msgspec.Struct, frozen=True):
    """Addresses of the service of a folder: HTTP for people, ZeroMQ for workers."""

    url: str
    hub: str


class DataFolder:
    """A folder that at most one service uses at a time."""

    def __init__(self, path: Path) -> None:
        self.path = path.resolve()
        self.lock = self.path / "service.lock"
        self.address_file = self.path / "service.json"

    @property
    def database(self) -> str:
        """The SQLAlchemy URL of its database."""
        return sqlite_url(self.database_file)

    @property
    def database_file(self) -> Path:
        """The file of its database."""
        return self.path / "eigenfail.db"

    @property
    def hub_keys(self) -> Path:
        """Path of the folder for the hub's keys, which may not exist."""
        return self.path / "hub-keys"

    def log(self, part: str) -> Path:
        """Return the path of the log of a part of the service."""
        return self.path / f"{part}.log"

    @contextmanager
    def claimed(self) -> Iterator[None]:
        """Lock the folder until the block ends; the system frees the lock if this process dies.

        Raises:
            StoreUnavailable: it cannot be made or written.
            ServiceError: another service runs on it.
        """
        # A lock of the kernel, not a file that is there or not: it is gone with its process.
        with self.open_lock() as lock:
            if not _lock(lock):
                raise ServiceError(
                    f"A service runs on {self.path} already{self.where()}.",
                    "Use that service, stop it, or choose another folder: data=… "
                    "(on the command line --data).",
                )
            # A service that was killed has left its address.
            self.address_file.unlink(missing_ok=True)
            try:
                yield
            finally:
                self.address_file.unlink(missing_ok=True)

    def open_lock(self) -> IO[bytes]:
        """Open the lock file; make it and its folder if needed.

        Raises:
            StoreUnavailable: it cannot be made or opened.
        """
        try:
            make_private_folder(self.path)
            return open_private(self.lock, "ab")
        except OSError as error:
            raise StoreUnavailable(
                f"The data folder {self.path} cannot be written: {error.strerror}.",
                "Choose another one: data=… (on the command line --data, or EIGENFAIL_DATA).",
            ) from error

    def publish(self, address: Address) -> None:
        """Write the address of this folder's service for other commands."""
        draft = self.address_file.with_suffix(".new")
        with open_private(draft, "wb") as file:
            file.write(msgspec.json.encode(address))
        # As a whole, so that no command reads half an address.
        draft.replace(self.address_file)

    def address(self) -> Address | None:
        """Return the address of this folder's service; None if no service runs."""
        with suppress(OSError, msgspec.DecodeError):
            address = msgspec.json.decode(self.address_file.read_bytes(), type=Address)
            with self.lock.open("rb") as lock:
                # A lock that is free shows that the service of this address was killed.
                return None if _lock(lock) else address
        return None

    def where(self) -> str:
        """Return the address in words."""
        address = self.address()
        return f", at {address.url}" if address else ""

    def is_writable(self) -> bool:
        """Return whether the folder, or its nearest existing parent, can be written."""
        existing = next(path for path in (self.path, *self.path.parents) if path.exists())
        return existing.is_dir() and os.access(existing, os.W_OK | os.X_OK)


def _lock(lock: IO[bytes]) -> bool:
    """Take the lock; return whether it was free. Closing the file releases it."""
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True
