"""The hub's keys: a folder with its own secret, and the public keys of the workers it lets in.

hub.key          the hub's secret
workers/NAME     the public keys of one worker; without the file, that worker is not let in
"""

import builtins
from collections.abc import Callable, Iterator
from pathlib import Path

import zmq
from zmq.utils import z85

from eigenfail.errors import Conflict, InvalidValue, NotFound
from eigenfail.private_files import FOLDER_MODE, read_private, replace_private, write_private
from eigenfail.wire.curve import (
    KEY_BYTES,
    NAME,
    AllowedWorker,
    NewHubKey,
    NewWorkerKey,
    WorkerKey,
    fingerprint,
    from_text,
    hub_text,
    read_worker_key,
    to_text,
)
from eigenfail_services.hub.allowed import Allowed, read_allowed, write_allowed
from eigenfail_services.store.clock import now_ms

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
    """A folder of keys, which its owner alone can read.

    Args:
        path: of the folder.
        now_ms: the wall clock; keys end by it.
    """

    def __init__(self, path: Path, now_ms: Callable[[], int] = now_ms) -> None:
        self.path = path
        self._now_ms = now_ms
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

    def create(self, name: str, file: Path, until_ms: int | None = None) -> NewWorkerKey:
        """Make a worker's key, let it in, and write it to a file; nothing, if that was done before.

        The hub's key is made with the first one, and the answer says so.

        Raises:
            InvalidValue: the name is none, or a file cannot be written.
            Conflict: another key has the name.
        """
        new_hub = self._prepare(name)
        hub = public_of(self.secret())
        if self.knows(name):
            return NewWorkerKey(self._made_before(name, hub, file).told())
        made = self._make(name, file, until_ms)
        self._write(name, made)
        return NewWorkerKey(made.told(), fingerprint(hub) if new_hub else "")

    def rotate(
        self, name: str, file: Path, until_ms: int | None = None, old_until_ms: int = 0
    ) -> NewWorkerKey:
        """Make another key of a name; those that it has are let in until a moment, or no more.

        Raises:
            NotFound: no key has the name.
            InvalidValue: a file cannot be written.
        """
        at_ms = self._now_ms()
        old = [key.ending(old_until_ms) for key in self._of(name)]
        made = self._make(name, file, until_ms)
        self._write(name, *(key for key in old if key.is_valid(at_ms)), made)
        return NewWorkerKey(made.told())

    def rotate_hub(self) -> NewHubKey:
        """Make the hub another key; one that runs takes it with its next start.

        Raises:
            InvalidValue: it has none, or the new one cannot be written.
        """
        self.secret()
        secret = new_secret()
        replace_private(self.hub_file, to_text(secret), FIELD)
        return NewHubKey(hub_text(public_of(secret)), fingerprint(public_of(secret)))

    def list(self) -> tuple[AllowedWorker, ...]:
        """The workers' keys, by name; those that have ended, too."""
        return tuple(key.told() for key in sorted(self.allowed(), key=by_name_and_age))

    def revoke(self, name: str) -> AllowedWorker:
        """Let a worker in no more; its keys are of no use to anybody then.

        Raises:
            NotFound: no key has the name.
        """
        *_, newest = self._of(name)
        (self._workers / name).unlink(missing_ok=True)
        return newest.told()

    def knows(self, name: str) -> bool:
        """Whether a key has the name.

        Raises:
            OSError: the folder cannot be read.
        """
        return any(key.name == name for key in self.allowed())

    def allowed(self) -> Iterator[Allowed]:
        """All keys of workers, also those that have ended; what is no key is passed over.

        Raises:
            OSError: the folder cannot be read.
        """
        files = self._workers.iterdir() if self._workers.is_dir() else ()
        for file in files:
            if file.is_file() and NAME.fullmatch(file.name):
                yield from read_allowed(file)

    def valid(self) -> Iterator[Allowed]:
        """Those that are let in now.

        Raises:
            OSError: the folder cannot be read.
        """
        at_ms = self._now_ms()
        return (key for key in self.allowed() if key.is_valid(at_ms))

    def _of(self, name: str) -> builtins.list[Allowed]:
        found = sorted(self.allowed(), key=by_name_and_age)
        if not any(key.name == name for key in found):
            known = ", ".join(dict.fromkeys(key.name for key in found)) or "none"
            raise NotFound(f"No worker's key is called '{name}'.", f"There are: {known}.")
        return [key for key in found if key.name == name]

    def _make(self, name: str, file: Path, until_ms: int | None) -> Allowed:
        secret = new_secret()
        write_private(file, WorkerKey(public_of(self.secret()), secret).text(), "--file")
        return Allowed(name, public_of(secret), self._now_ms(), until_ms)

    def _write(self, name: str, *keys: Allowed) -> None:
        write_allowed(self._workers / name, keys, FIELD)

    def _prepare(self, name: str) -> bool:
        """Whether there was no key of a hub before."""
        if not NAME.fullmatch(name):
            remedy = "Up to 64 letters, digits, dots, dashes and underlines; no dot at its begin."
            raise InvalidValue("NAME", f"'{name}' is no name of a key.", remedy)
        try:
            for folder in (self.path, self._workers):
                folder.mkdir(FOLDER_MODE, parents=True, exist_ok=True)
        except OSError as error:
            raise closed_to_us(self.path, error) from error
        if self.hub_file.exists():
            return False
        write_private(self.hub_file, to_text(new_secret()), FIELD)
        return True

    def _made_before(self, name: str, hub: bytes, file: Path) -> Allowed:
        """So that who starts a service may ask for the key every time."""
        if file.exists():
            key = read_worker_key(read_private(file, "--file"), "--file")
            public = public_of(key.secret)
            for each in self.allowed():
                if key.hub == hub and (each.name, each.public) == (name, public):
                    return each
        raise Conflict(
            f"A worker's key is called '{name}' already.", "Choose another name, or revoke it."
        )


def by_name_and_age(key: Allowed) -> tuple[str, int]:
    """In which order keys are listed."""
    return key.name, key.made_ms


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
        return self.let_in().get(public)

    def let_in(self) -> dict[bytes, str]:
        """All keys that are let in now, and whose they are.

        Raises:
            OSError: the folder cannot be read.
        """
        return {key.public: key.name for key in self._folder.valid()} | self._own
