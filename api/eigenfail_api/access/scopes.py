"""Callers of the API, and the scope that each request requires."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from re import Pattern

from starlette.routing import compile_path

from eigenfail.values.access import ApiKey, Scope
from eigenfail.wire.http import PREFIX

SAFE = frozenset({"GET", "HEAD", "OPTIONS"})
"""Methods that change nothing."""

OPEN = ("GET /healthz", "GET /readyz", "GET /login", "POST /login", "GET /static/{file:path}")
"""Requests that require no key."""

# Reading requires a viewer and everything else an administrator, unless this table differs.
REQUIRED: Mapping[Scope, tuple[str, ...]] = {
    # Requests that send a body but change nothing that others see.
    Scope.VIEWER: (f"POST {PREFIX}/campaigns/check", "POST /launch/form", "POST /logout"),
    Scope.RUNNER: (
        f"POST {PREFIX}/campaigns",
        f"POST {PREFIX}/campaigns/bulk",
        f"POST {PREFIX}/campaigns/{{campaign}}/clone",
        f"POST {PREFIX}/campaigns/{{campaign}}/pause",
        f"POST {PREFIX}/campaigns/{{campaign}}/resume",
        f"POST {PREFIX}/campaigns/{{campaign}}/cancel",
        f"POST {PREFIX}/campaigns/{{campaign}}/priority",
        f"POST {PREFIX}/campaigns/{{campaign}}/analyses",
        f"POST {PREFIX}/campaigns/{{campaign}}/exports",
        f"POST {PREFIX}/campaigns/{{campaign}}/episodes/{{index}}/replay",
        f"POST {PREFIX}/analyses/{{analysis}}/proof",
    ),
    Scope.ADMIN: (
        "GET /audit",
        "GET /keys",
        f"GET {PREFIX}/audit",
        f"GET {PREFIX}/keys",
        f"GET {PREFIX}/keys/{{key}}",
        f"POST {PREFIX}/keys",
        f"POST {PREFIX}/keys/{{key}}/quotas",
        f"GET {PREFIX}/keys/{{key}}/usage",
        f"DELETE {PREFIX}/keys/{{key}}",
    ),
}


def _compile_rules() -> Iterator[tuple[str, Pattern[str], Scope | None]]:
    for scope, lines in ((None, OPEN), *REQUIRED.items()):
        for method, address in (line.split(" ") for line in lines):
            yield method, compile_path(address)[0], scope


RULES = tuple(_compile_rules())


def required_scope(method: str, path: str) -> Scope | None:
    """Return the least scope with which a request is answered; None if it requires no key."""
    asked = "GET" if method == "HEAD" else method
    for known, pattern, scope in RULES:
        # As the router does: its pattern also takes a newline behind the address.
        if known == asked and pattern.match(path):
            return scope
    return Scope.VIEWER if asked == "GET" else Scope.ADMIN


def is_change(method: str, path: str) -> bool:
    """Whether a request changes something, so that it belongs in the audit log."""
    return method not in SAFE and required_scope(method, path) in {Scope.RUNNER, Scope.ADMIN}


@dataclass(frozen=True)
class Caller:
    """The sender of a request.

    Attributes:
        name: of the key; `loopback` or `network` where no key is required.
        scope: what the key allows.
        key: its id.
        signed_in: whether the key was given on the login page, and a cookie stands for it.
    """

    name: str
    scope: Scope
    key: int | None = None
    signed_in: bool = False


_caller: ContextVar[Caller | None] = ContextVar("caller", default=None)


@contextmanager
def act_as(caller: Caller | None) -> Iterator[None]:
    """Answer requests of this caller within the block."""
    before = _caller.set(caller)
    try:
        yield
    finally:
        _caller.reset(before)


def find_caller_without(scope: Scope) -> Caller | None:
    """Return the caller if the scope exceeds that of their key."""
    caller = _caller.get()
    return None if caller is None or caller.scope.allows(scope) else caller


def get_signed_in_caller() -> Caller | None:
    """Return the caller who is signed in with a browser; None for any other."""
    caller = _caller.get()
    return caller if caller is not None and caller.signed_in else None


async def get_caller_key() -> int | None:
    """Return the id of the caller's key; None where no key is required."""
    caller = _caller.get()
    return None if caller is None else caller.key


def caller_of_key(key: ApiKey, *, signed_in: bool = False) -> Caller:
    """Return the holder of a key."""
    return Caller(key.name, key.scope, key.id, signed_in)
