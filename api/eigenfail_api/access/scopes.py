"""Which scope a request needs: what is read, any key; for everything else, the table says it.

What the table does not know needs an administrator.
"""

from collections.abc import Iterator, Mapping
from re import Pattern

from starlette.routing import compile_path

from eigenfail.values.access import Scope
from eigenfail.wire.http import PREFIX

SAFE = frozenset({"GET", "HEAD", "OPTIONS"})
"""Methods that change nothing."""

OPEN = ("GET /healthz", "GET /readyz", "GET /login", "POST /login", "GET /static/{file:path}")
"""For whoever asks, with a key or without."""

NEEDED: Mapping[Scope, tuple[str, ...]] = {
    # What is sent, but changes nothing that others see.
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


def compiled() -> Iterator[tuple[str, Pattern[str], Scope | None]]:
    """The tables as methods, patterns of addresses, and scopes; none where nothing is needed."""
    for scope, lines in ((None, OPEN), *NEEDED.items()):
        for method, address in (line.split(" ") for line in lines):
            yield method, compile_path(address)[0], scope


RULES = tuple(compiled())


def needed(method: str, path: str) -> Scope | None:
    """The least scope with which a request is answered; None where no key is needed at all."""
    asked = "GET" if method == "HEAD" else method
    for known, pattern, scope in RULES:
        # As the router does: its pattern also takes a newline behind the address.
        if known == asked and pattern.match(path):
            return scope
    return Scope.VIEWER if asked == "GET" else Scope.ADMIN


def changes(method: str, path: str) -> bool:
    """Whether a request changes something, so that the audit log has to tell of it."""
    return method not in SAFE and needed(method, path) in {Scope.RUNNER, Scope.ADMIN}
