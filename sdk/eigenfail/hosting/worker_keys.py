"""Keys of workers, in the folder of a hub on this machine."""

import os
from pathlib import Path
from typing import TypeVar

import msgspec

from eigenfail.hosting.folder import DataFolder
from eigenfail.hosting.service import services_program
from eigenfail.private_files import read_private, replace_private
from eigenfail.wire.curve import (
    AllowedWorker,
    NewHubKey,
    NewWorkerKey,
    read_hub_key,
    read_worker_key,
)

DATABASE = "EIGENFAIL_DATABASE"

Kind = TypeVar("Kind")


class WorkerKeys:
    """Makes, renews, lists and revokes the keys that a hub lets in.

    What is changed is told to the audit log, where there is a database: that which the environment
    names, or else the data folder's.

    Every method raises ServiceError or InputError where the folder, or what was asked for, is not
    in order.

    Args:
        data: the folder of the service.
        folder: of the hub's keys, if it is another one than the service's.
    """

    def __init__(self, data: Path, folder: Path | None = None) -> None:
        service = DataFolder(data)
        self._folder = folder or service.hub_keys
        known = folder is None and DATABASE not in os.environ and service.database_file.exists()
        self._variables = {DATABASE: service.database} if known else {}

    def create(self, name: str, file: Path, expires_s: int | None = None) -> NewWorkerKey:
        """Make a key, and write it to a file that the worker is then given."""
        words = ("create", f"--name={name}", f"--file={file}", *given("expires-s", expires_s))
        return self._said(NewWorkerKey, *words)

    def list(self) -> tuple[AllowedWorker, ...]:
        """The keys by name; those that have ended, too."""
        return self._said(tuple[AllowedWorker, ...], "list")

    def rotate(
        self, name: str, file: Path, expires_s: int | None = None, keep_s: int | None = None
    ) -> NewWorkerKey:
        """Make another key of a name; the one that it had is let in for a while, or no more."""
        words = ("rotate", f"--name={name}", f"--file={file}")
        times = (*given("expires-s", expires_s), *given("keep-s", keep_s))
        return self._said(NewWorkerKey, *words, *times)

    def rotate_hub(self) -> NewHubKey:
        """Make the hub another key, which it takes with its next start."""
        return self._said(NewHubKey, "rotate-hub")

    def revoke(self, name: str) -> AllowedWorker:
        """Let a key in no more, for good."""
        return self._said(AllowedWorker, "revoke", f"--name={name}")

    def _said(self, kind: type[Kind], *words: str) -> Kind:
        folder = f"--hub-keys={self._folder}"
        said = services_program(("worker-key", *words, folder), self._variables)
        return msgspec.json.decode(said, type=kind)


def follow(file: Path, hub: str) -> None:
    """Have a worker's key, in a file, know the hub by another key.

    Raises:
        InvalidValue: the file holds no key, or cannot be written; or the text is no hub's key.
    """
    key = read_worker_key(read_private(file, "FILE"), "FILE")
    replace_private(file, key.following(read_hub_key(hub, "HUB")).text(), "FILE")


def given(option: str, seconds: int | None) -> tuple[str, ...]:
    """An option of the program, if there is something to tell."""
    return () if seconds is None else (f"--{option}={seconds}",)
