"""Keys and the audit log, as they are printed."""

from collections.abc import Iterable, Iterator
from time import time

from msgspec.structs import asdict
from rich.markup import escape
from rich.table import Table

from eigenfail.cli.figures import UNKNOWN
from eigenfail.cli.moments import utc
from eigenfail.cli.tables import table
from eigenfail.values.access import ApiKey, AuditEntry, NewKey
from eigenfail.values.quotas import Quotas


def new_key(made: NewKey) -> str:
    """A key that was just made, with what its holder has to do."""
    key = made.key
    ends = "it is revoked" if key.expires_ms is None else f"{utc(key.expires_ms)} UTC"
    return (
        f"Key {key.id} for '{key.name}', {key.scope}, until {ends}. It is shown this once:\n\n"
        f"{made.token}\n\n"
        "Put it into EIGENFAIL_KEY for commands and programs, or sign in with it at /login."
    )


def key_table(keys: Iterable[ApiKey]) -> Table:
    """One row for each key; times in UTC."""
    at_ms = round(1_000 * time())
    grid = table(
        "id", "name", "scope", "state", "quotas", "made", "ends", "last used", right=("id",)
    )
    for key in keys:
        times = (key.created_ms, key.expires_ms, key.last_used_ms)
        told = (UNKNOWN if each is None else utc(each) for each in times)
        allowed = ", ".join(quotas(key.quotas)) or UNKNOWN
        grid.add_row(str(key.id), escape(key.name), key.scope, state(key, at_ms), allowed, *told)
    return grid


def state(key: ApiKey, at_ms: int) -> str:
    """Whether a key opens anything."""
    if key.revoked_ms is not None:
        return "revoked"
    return "valid" if key.is_valid(at_ms) else "expired"


def quotas(given: Quotas) -> Iterator[str]:
    """The quotas that a key has."""
    for name, limit in asdict(given).items():
        if limit is not None:
            yield f"{name} {limit:,}"


def audit_table(entries: Iterable[AuditEntry]) -> Table:
    """One row for each change."""
    grid = table("when [UTC]", "who", "key", "what", "subject", "from", "status", right=("status",))
    for entry in entries:
        key = UNKNOWN if entry.key is None else str(entry.key)
        what = f"{entry.method} {entry.route}"
        told = (entry.who, key, what, entry.subject, entry.address or UNKNOWN)
        grid.add_row(utc(entry.at_ms), *map(escape, told), str(entry.status))
    return grid
