"""Who asks, for as long as a request is answered."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

from eigenfail.values.access import ApiKey, Scope


@dataclass(frozen=True)
class Caller:
    """Who asks.

    Attributes:
        name: of the key; `loopback` or `network` where nobody has to show one.
        scope: what the key allows.
        key: its id.
        signed_in: whether it was shown on the page of the login, and a cookie stands for it.
    """

    name: str
    scope: Scope
    key: int | None = None
    signed_in: bool = False


_caller: ContextVar[Caller | None] = ContextVar("caller", default=None)


@contextmanager
def acting(caller: Caller | None) -> Iterator[None]:
    """Within the block, it is this caller who asks."""
    before = _caller.set(caller)
    try:
        yield
    finally:
        _caller.reset(before)


def lacking(needed: Scope) -> Caller | None:
    """Who asks, if their key allows less than is needed."""
    caller = _caller.get()
    return None if caller is None or caller.scope.allows(needed) else caller


def signed_in() -> Caller | None:
    """Who is signed in with a browser, if anybody is."""
    caller = _caller.get()
    return caller if caller is not None and caller.signed_in else None


async def key_of_caller() -> int | None:
    """The id of the key of whoever asks; None where nobody has to show one."""
    caller = _caller.get()
    return None if caller is None else caller.key


def by_key(key: ApiKey, signed_in: bool = False) -> Caller:
    """Whoever holds a key."""
    return Caller(key.name, key.scope, key.id, signed_in)
