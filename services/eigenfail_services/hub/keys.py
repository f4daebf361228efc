"""The hub's keys: a folder with its own secret, and the public keys of the workers it accepts.

hub.key          the hub's secret
workers/NAME     the public keys of one worker; without the file, that worker is not accepted

A worker's file has one line for each key; there are two while a key is being renewed. A line holds
the public key, when it was created and when it expires, in milliseconds since 1970; a dash means
never. A key that was put there by hand may come without the times.
"""

import builtins
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import zmq
from zmq.utils import z85

from eigenfail.errors import Conflict, InvalidValue, NotFound
from eigenfail.files import (
    make_private_folder,
    read_private,
    replace_private,
    write_private,
)
from eigenfail.wire.keys import (
    KEY_BYTES,
    NAME,
    AllowedWorker,
    NewHubKey,
    NewWorkerKey,
    WorkerKey,
    abbreviate_key,
    decode_key,
    encode_key,
    format_hub_key,
    read_worker_key,
)
from eigenfail_services.store.clock import now_ms

FIELD = "--hub-keys"
CREATE_REMEDY = "Create keys with `eigenfail worker key create NAME --hub-keys {}`."

NEVER = "-"


def generate_secret() -> bytes:
    """Return a new secret key."""
    return z85.decode(zmq.curve_keypair()[1])


def derive_public_key(secret: bytes) -> bytes:
    """Return the public key that belongs to a secret key."""
    return z85.decode(zmq.curve_public(z85.encode(secret)))


def unusable_folder(folder: Path, error: OSError) -> InvalidValue:
    """Return the error for a folder that cannot be used."""
    problem = f"'{folder}' cannot be used: {error.strerror}."
    return InvalidValue(FIELD, problem, "Name another folder, or run this as its owner.")


class StoredKey(msgspec.Struct, frozen=True):
    """A worker's public key, its name, and the times between which it is accepted.

    Attributes:
        name: name of the worker.
        public: the key.
        made_ms: when it was created. [ms since 1970]
        until_ms: when it expires, if it does. [ms since 1970]
    """

    name: str
    public: bytes
    made_ms: int
    until_ms: int | None = None

    def is_valid(self, at_ms: int) -> bool:
        """Return whether the key has not expired at a moment."""
        return self.until_ms is None or at_ms < self.until_ms

    def expire_by(self, at_ms: int) -> "StoredKey":
        """Return the same key, expiring no later than at a moment."""
        until_ms = at_ms if self.until_ms is None else min(at_ms, self.until_ms)
        return msgspec.structs.replace(self, until_ms=until_ms)

    def format_line(self) -> str:
        """Return the line of the worker's file for this key."""
        until = NEVER if self.until_ms is None else str(self.until_ms)
        return f"{encode_key(self.public)} {self.made_ms} {until}"

    def summarize(self) -> AllowedWorker:
        """Return the key without its public part, for lists."""
        return AllowedWorker(self.name, abbreviate_key(self.public), self.made_ms, self.until_ms)


def _read_file(file: Path) -> Iterator[StoredKey]:
    """Yield the keys in a worker's file; a line that holds none is skipped."""
    made_ms = round(1_000 * file.stat().st_mtime)
    for line in file.read_text(errors="replace").splitlines():
        words = line.split()
        public = decode_key(words[0], KEY_BYTES) if words else None
        if public is not None:
            yield StoredKey(file.name, public, *_parse_times(words[1:], made_ms))


def _parse_times(words: list[str], made_ms: int) -> tuple[int, int | None]:
    """Return when a key was created and when it expires; an unreadable time has passed."""
    if not words:
        return made_ms, None
    made, until, *_ = *words, NEVER
    until_ms = int(until) if until.isdecimal() else 0
    return int(made) if made.isdecimal() else made_ms, None if until == NEVER else until_ms


def _by_name_and_age(key: StoredKey) -> tuple[str, int]:
    return key.name, key.made_ms


class KeyFolder:
    """A folder of keys, which only its owner can read.

    Args:
        path: path of the folder.
        now_ms: wall clock for the expiry of keys.
    """

    def __init__(self, path: Path, now_ms: Callable[[], int] = now_ms) -> None:
        self.path = path
        self._now_ms = now_ms
        self.hub_file = path / "hub.key"
        self._workers = path / "workers"

    def secret(self) -> bytes:
        """Return the hub's secret key.

        Raises:
            InvalidValue: there is none, or other users can read it.
        """
        remedy = CREATE_REMEDY.format(self.path)
        if not self.hub_file.exists():
            raise InvalidValue(FIELD, f"there is no hub key in '{self.path}'.", remedy)
        secret = decode_key(read_private(self.hub_file, FIELD), KEY_BYTES)
        if secret is None:
            raise InvalidValue(FIELD, f"'{self.hub_file}' is not a key.", remedy)
        return secret

    def create(self, name: str, file: Path, until_ms: int | None = None) -> NewWorkerKey:
        """Create and accept a worker's key, and write it to a file.

        If the file holds the accepted key of that name, nothing is changed, so that a script that
        starts a service can ask for the key every time. The hub's key is created with the first
        worker key, and the answer says so.

        Raises:
            InvalidValue: the name is invalid, or a file cannot be written.
            Conflict: another key has the name.
        """
        is_new_hub = self._prepare(name)
        hub = derive_public_key(self.secret())
        if self.knows(name):
            return NewWorkerKey(self._find_created(name, hub, file).summarize())
        # The worker's file comes first: if it cannot be written, the hub accepts no key that
        # nobody has.
        created = self._create(name, file, until_ms)
        self._write(name, created)
        return NewWorkerKey(created.summarize(), abbreviate_key(hub) if is_new_hub else "")

    def rotate(
        self, name: str, file: Path, until_ms: int | None = None, old_until_ms: int = 0
    ) -> NewWorkerKey:
        """Create another key of a name; the present ones expire at a moment, by default at once.

        Raises:
            NotFound: no key has the name.
            InvalidValue: a file cannot be written.
        """
        at_ms = self._now_ms()
        old = [key.expire_by(old_until_ms) for key in self._find(name)]
        # As in `create`, the file comes first: the old keys stay if it cannot be written.
        created = self._create(name, file, until_ms)
        self._write(name, *(key for key in old if key.is_valid(at_ms)), created)
        return NewWorkerKey(created.summarize())

    def rotate_hub(self) -> NewHubKey:
        """Create another hub key; a running hub uses it after its next start.

        Raises:
            InvalidValue: the hub does not have a key yet, or the new one cannot be written.
        """
        self.secret()
        secret = generate_secret()
        replace_private(self.hub_file, encode_key(secret), FIELD)
        public = derive_public_key(secret)
        return NewHubKey(format_hub_key(public), abbreviate_key(public))

    def list(self) -> tuple[AllowedWorker, ...]:
        """Return the worker keys by name, the expired ones included."""
        return tuple(key.summarize() for key in sorted(self.read_all(), key=_by_name_and_age))

    def revoke(self, name: str) -> AllowedWorker:
        """Delete the keys of a name, so that they are not accepted any more; return the newest.

        Raises:
            NotFound: no key has the name.
        """
        *_, newest = self._find(name)
        # Another command may have revoked it meanwhile.
        (self._workers / name).unlink(missing_ok=True)
        return newest.summarize()

    def knows(self, name: str) -> bool:
        """Return whether a key has the name.

        Raises:
            OSError: the folder cannot be read.
        """
        return any(key.name == name for key in self.read_all())

    def read_all(self) -> Iterator[StoredKey]:
        """Yield all worker keys, the expired ones included; files that hold none are skipped.

        Raises:
            OSError: the folder cannot be read.
        """
        files = self._workers.iterdir() if self._workers.is_dir() else ()
        for file in files:
            if file.is_file() and NAME.fullmatch(file.name):
                yield from _read_file(file)

    def read_valid(self) -> Iterator[StoredKey]:
        """Return the worker keys that have not expired.

        Raises:
            OSError: the folder cannot be read.
        """
        at_ms = self._now_ms()
        return (key for key in self.read_all() if key.is_valid(at_ms))

    def _find(self, name: str) -> builtins.list[StoredKey]:
        keys = sorted(self.read_all(), key=_by_name_and_age)
        if not any(key.name == name for key in keys):
            known = ", ".join(dict.fromkeys(key.name for key in keys)) or "none"
            raise NotFound(f"No worker key is called '{name}'.", f"There are: {known}.")
        return [key for key in keys if key.name == name]

    def _create(self, name: str, file: Path, until_ms: int | None) -> StoredKey:
        secret = generate_secret()
        write_private(file, WorkerKey(derive_public_key(self.secret()), secret).text(), "--file")
        return StoredKey(name, derive_public_key(secret), self._now_ms(), until_ms)

    def _write(self, name: str, *keys: StoredKey) -> None:
        lines = "\n".join(key.format_line() for key in keys)
        replace_private(self._workers / name, lines, FIELD)

    def _prepare(self, name: str) -> bool:
        """Create the folder and the hub's key; return whether the hub's key is new."""
        # The name becomes that of a file: it must not lead out of the folder.
        if not NAME.fullmatch(name):
            remedy = "Use up to 64 letters, digits, dots, dashes and underscores; no dot at first."
            raise InvalidValue("NAME", f"'{name}' is not a valid key name.", remedy)
        try:
            for folder in (self.path, self._workers):
                make_private_folder(folder)
        except OSError as error:
            raise unusable_folder(self.path, error) from error
        if self.hub_file.exists():
            return False
        write_private(self.hub_file, encode_key(generate_secret()), FIELD)
        return True

    def _find_created(self, name: str, hub: bytes, file: Path) -> StoredKey:
        """Return the accepted key of a name that a file holds."""
        if file.exists():
            key = read_worker_key(read_private(file, "--file"), "--file")
            public = derive_public_key(key.secret)
            for each in self.read_all():
                if key.hub == hub and (each.name, each.public) == (name, public):
                    return each
        raise Conflict(
            f"A worker key called '{name}' exists already.", "Choose another name, or revoke it."
        )


class HubKeys:
    """The secret of a running hub, and the keys it accepts: a folder's keys and its own workers'.

    Raises:
        InvalidValue: the folder does not hold a hub key.
    """

    def __init__(self, folder: KeyFolder) -> None:
        self.secret = folder.secret()
        self._folder = folder
        self._own: dict[bytes, str] = {}

    def create_own(self, name: str) -> WorkerKey:
        """Return a new key for workers that this process starts itself, kept in memory only."""
        secret = generate_secret()
        self._own[derive_public_key(secret)] = name
        return WorkerKey(derive_public_key(self.secret), secret)

    def list_accepted(self) -> dict[bytes, str]:
        """Return the names of all accepted keys, by public key.

        Raises:
            OSError: the folder cannot be read.
        """
        return {key.public: key.name for key in self._folder.read_valid()} | self._own
