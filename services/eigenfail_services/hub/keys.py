"""The hub's keys: a folder with its own secret, and the public keys of the workers it lets in.

hub.key          the hub's secret
workers/NAME     the public key of one worker; without the file, that worker is not let in
"""

from collections.abc import Iterator
from pathlib import Path

import zmq
from zmq.utils import z85

from eigenfail.errors import Conflict, InvalidValue, NotFound
from eigenfail.private_files import read_private, write_private
from eigenfail.wire.curve import (
    KEY_BYTES,
    NAME,
    AllowedWorker,
    WorkerKey,
    fingerprint,
    from_text,
    read_worker_key,
    to_text,
)

FIELD = "--hub-keys"
MAKE = "Make keys: eigenfail worker key create NAME --hub-keys {}"


def new_secret() -> bytes:
    """A secret of one's own."""
    return z85.decode(zmq.curve_keypair()[1])


def public_of(secret: bytes) -> bytes:
    """The public key that belongs to a secret one."""
    return z85.decode(zmq.curve_public(z85.encode(secret)))


def closed_to_us(folder: Path, error: OSError) -> InvalidValue:
    """The refusal of a folder that cannot be used."""
    problem = f"'{folder}' cannot be used: {error.strerror}."
    return InvalidValue(FIELD, problem, "Name another folder, or run this as its owner.")


class KeyFolder:
    """A folder of keys, which its owner alone can read."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.hub_file = path / "hub.key"
        self._workers = path / "workers"

    def secret(self) -> bytes:
        """The hub's.

        Raises:
            InvalidValue: there is none, or everybody can read it.
        """
        if not self.hub_file.exists():
            remedy = MAKE.format(self.path)
            raise InvalidValue(FIELD, f"there is no key of a hub in '{self.path}'.", remedy)
        secret = from_text(read_private(self.hub_file, FIELD), KEY_BYTES)
        if secret is None:
            raise InvalidValue(FIELD, f"'{self.hub_file}' is no key.", MAKE.format(self.path))
        return secret

    def create(self, name: str, file: Path) -> AllowedWorker:
        """Make a worker's key, let it in, and write it to a file; nothing, if that was done before.

        The hub's key is made with the first one.

        Raises:
            InvalidValue: the name is none, or a file cannot be written.
            Conflict: another key has the name.
        """
        self._prepare(name)
        hub = public_of(self.secret())
        if name in {worker.name for worker in self.list()}:
            return self._made_before(name, hub, file)
        secret = new_secret()
        write_private(file, WorkerKey(hub, secret).text(), "--file")
        write_private(self._workers / name, to_text(public_of(secret)), FIELD)
        return self._told(name, public_of(secret))

    def list(self) -> tuple[AllowedWorker, ...]:
        """Who is let in, by name."""
        return tuple(self._told(name, public) for name, public in sorted(self.allowed()))

    def revoke(self, name: str) -> AllowedWorker:
        """Let a worker in no more; its key is of no use to anybody then.

        Raises:
            NotFound: no key has the name.
        """
        found = {worker.name: worker for worker in self.list()}
        if name not in found:
            known = ", ".join(found) or "none"
            raise NotFound(f"No worker's key is called '{name}'.", f"There are: {known}.")
        (self._workers / name).unlink(missing_ok=True)
        return found[name]

    def allowed(self) -> Iterator[tuple[str, bytes]]:
        """Names and public keys; what is no key is passed over.

        Raises:
            OSError: the folder cannot be read.
        """
        files = self._workers.iterdir() if self._workers.is_dir() else ()
        for file in filter(Path.is_file, files):
            public = from_text(file.read_text(errors="replace").strip(), KEY_BYTES)
            if public is not None:
                yield file.name, public

    def _prepare(self, name: str) -> None:
        if not NAME.fullmatch(name):
            remedy = "Up to 64 letters, digits, dots, dashes and underlines; no dot at its begin."
            raise InvalidValue("NAME", f"'{name}' is no name of a key.", remedy)
        try:
            for folder in (self.path, self._workers):
                folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        except OSError as error:
            raise closed_to_us(self.path, error) from error
        if not self.hub_file.exists():
            write_private(self.hub_file, to_text(new_secret()), FIELD)

    def _made_before(self, name: str, hub: bytes, file: Path) -> AllowedWorker:
        """So that who starts a service may ask for the key every time."""
        if file.exists():
            key = read_worker_key(read_private(file, "--file"), "--file")
            public = public_of(key.secret)
            if key.hub == hub and (name, public) in self.allowed():
                return self._told(name, public)
        raise Conflict(
            f"A worker's key is called '{name}' already.", "Choose another name, or revoke it."
        )

    def _told(self, name: str, public: bytes) -> AllowedWorker:
        made_s = (self._workers / name).stat().st_mtime
        return AllowedWorker(name, fingerprint(public), round(1_000 * made_s))


class HubKeys:
    """What a running hub shows, and whom it lets in: who is in the folder, and workers of its own.

    Raises:
        InvalidValue: there is no key of a hub in the folder.
    """

    def __init__(self, folder: KeyFolder) -> None:
        self.secret = folder.secret()
        self._folder = folder
        self._own: dict[bytes, str] = {}

    def own(self, name: str) -> WorkerKey:
        """A key for workers that this process starts itself; it is kept in memory alone."""
        secret = new_secret()
        self._own[public_of(secret)] = name
        return WorkerKey(public_of(self.secret), secret)

    def name_of(self, public: bytes) -> str | None:
        """Whose key it is; None if nobody's who is let in now.

        Raises:
            OSError: the folder cannot be read.
        """
        if name := self._own.get(public):
            return name
        return next((name for name, key in self._folder.allowed() if key == public), None)
