"""The key of the first administrator, made where nobody is there to write it down: into a file."""

from pathlib import Path

import msgspec

from eigenfail.errors import InvalidValue
from eigenfail.private_files import replace_private
from eigenfail.values.access import ApiKey, KeyRequest, Scope
from eigenfail_services.access.keys import make_key
from eigenfail_services.store import Store
from eigenfail_services.store.clock import now_ms

FIELD = "--file"


class FirstKey(msgspec.Struct, frozen=True):
    """What became of it, without its secret.

    Attributes:
        made: the key that was made; null where an administrator has one already.
        file: where its secret is.
    """

    made: ApiKey | None
    file: str


def first_key(store: Store, name: str, file: Path) -> FirstKey:
    """An administrator's key in a file for its owner alone, unless one has a valid key already.

    An empty file is one that broke off between the two: then another key is made.

    Raises:
        InvalidValue: the file cannot be read or written; no key is made then.
    """
    broke_off = _is_empty(file)
    if store.keys.admins(now_ms()) and not broke_off:
        return FirstKey(None, str(file))
    replace_private(file, "", FIELD)
    made = make_key(store, KeyRequest(name, Scope.ADMIN))
    replace_private(file, made.token, FIELD)
    return FirstKey(made.key, str(file))


def _is_empty(file: Path) -> bool:
    try:
        return not file.read_text().strip()
    except FileNotFoundError:
        return False
    except (OSError, UnicodeDecodeError) as error:
        problem = f"'{file}' cannot be read: {getattr(error, 'strerror', 'it is no text')}."
        raise InvalidValue(FIELD, problem, "Name another, or take that one away.") from error
