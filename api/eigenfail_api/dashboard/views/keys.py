"""Keys and the audit log, as tables."""

from collections.abc import Iterator, Mapping

import msgspec

from eigenfail.values import Page
from eigenfail.values.access import ApiKey, AuditEntry, Scope
from eigenfail.values.quotas import Quotas, Usage
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.paging import Pager, pager
from eigenfail_api.dashboard.views.states import Badge

VALID = Badge("valid", "✓", "good")
EXPIRED = Badge("expired", "○", "ended")
REVOKED = Badge("revoked", "×", "ended")

REFUSED = 400

LIMITS = {
    "max_open": "Campaigns open at once, at most",
    "max_episodes": "Episodes in one, at most",
    "max_episodes_per_day": "Episodes in 24 h, at most",
}


class KeyLine(msgspec.Struct, frozen=True, kw_only=True):
    """A key in the table; `can_revoke` as long as it opens anything.

    Attributes:
        quotas: how much may be done with it, and how much of that is used.
        limits: the same as the fields of a form: name, label, value.
    """

    id: int
    name: str
    scope: Scope
    badge: Badge
    made: str
    used: str
    quotas: tuple[str, ...]
    limits: tuple[tuple[str, str, int | None], ...]
    ends: str
    can_revoke: bool


class KeysView(msgspec.Struct, frozen=True, kw_only=True):
    """The page of keys.

    Attributes:
        pages: where one is among them.
        is_locked: whether everybody needs a key.
        limits: the quotas that a key may have: name and label.
    """

    lines: tuple[KeyLine, ...]
    pages: Pager
    is_locked: bool
    limits: tuple[tuple[str, str], ...]


class ChangeLine(msgspec.Struct, frozen=True, kw_only=True):
    """A line of the audit log; `was_refused` if nothing came of it."""

    at: str
    who: str
    did: str
    subject: str
    address: str
    status: int
    was_refused: bool


class AuditView(msgspec.Struct, frozen=True, kw_only=True):
    """The page of the audit log."""

    lines: tuple[ChangeLine, ...]
    pages: Pager


def keys_view(
    listed: Page[ApiKey],
    usage: Mapping[int, Usage],
    before: int | None,
    at_ms: int,
    *,
    is_locked: bool,
) -> KeysView:
    """The page of keys at a moment."""
    return KeysView(
        lines=tuple(key_line(key, usage[key.id], at_ms) for key in listed.items),
        pages=pager("/keys", before, listed.next),
        is_locked=is_locked,
        limits=tuple(LIMITS.items()),
    )


def key_line(key: ApiKey, usage: Usage, at_ms: int) -> KeyLine:
    """One of them."""
    return KeyLine(
        id=key.id,
        name=key.name,
        scope=key.scope,
        badge=badge_of(key, at_ms),
        made=formats.moment(key.created_ms),
        used=formats.moment(key.last_used_ms),
        quotas=tuple(quotas(key.quotas, usage)),
        limits=tuple((name, words, getattr(key.quotas, name)) for name, words in LIMITS.items()),
        ends=formats.moment(key.revoked_ms or key.expires_ms),
        can_revoke=key.is_valid(at_ms),
    )


def quotas(given: Quotas, usage: Usage) -> Iterator[str]:
    """Each quota that a key has, and what is used of it."""
    if given.max_open is not None:
        yield f"{usage.open:,} of {given.max_open:,} campaigns open"
    if given.max_episodes is not None:
        yield f"{given.max_episodes:,} episodes in one"
    if given.max_episodes_per_day is not None:
        yield f"{usage.episodes_of_day:,} of {given.max_episodes_per_day:,} episodes in 24 h"


def badge_of(key: ApiKey, at_ms: int) -> Badge:
    """Whether it opens anything, and why not."""
    if key.is_valid(at_ms):
        return VALID
    return REVOKED if key.revoked_ms else EXPIRED


def audit_view(listed: Page[AuditEntry], before: int | None) -> AuditView:
    """The page of the audit log."""
    return AuditView(
        lines=tuple(map(change_line, listed.items)),
        pages=pager("/audit", before, listed.next),
    )


def change_line(entry: AuditEntry) -> ChangeLine:
    """One of them."""
    return ChangeLine(
        at=formats.moment(entry.at_ms),
        who=entry.who if entry.key is None else f"{entry.who} ({entry.key})",
        did=f"{entry.method} {entry.route}",
        subject=entry.subject,
        address=entry.address,
        status=entry.status,
        was_refused=entry.status >= REFUSED,
    )
