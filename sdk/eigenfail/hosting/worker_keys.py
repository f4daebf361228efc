"""Keys of workers, in the folder of a hub on this machine."""

from pathlib import Path
from typing import TypeVar

import msgspec

from eigenfail.hosting.service import services_program
from eigenfail.wire.curve import AllowedWorker

Kind = TypeVar("Kind")


class WorkerKeys:
    """Makes, lists and revokes the keys that a hub lets in.

    Every method raises ServiceError or InputError where the folder, or what was asked for, is not
    in order.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def create(self, name: str, file: Path) -> AllowedWorker:
        """Make a key, and write it to a file that the worker is then given."""
        return self._said(AllowedWorker, "create", f"--name={name}", f"--file={file}")

    def list(self) -> tuple[AllowedWorker, ...]:
        """The keys that are let in, by name."""
        return self._said(tuple[AllowedWorker, ...], "list")

    def revoke(self, name: str) -> AllowedWorker:
        """Let a key in no more, for good."""
        return self._said(AllowedWorker, "revoke", f"--name={name}")

    def _said(self, kind: type[Kind], *words: str) -> Kind:
        folder = f"--hub-keys={self._folder}"
        return msgspec.json.decode(services_program(("worker-key", *words, folder)), type=kind)
