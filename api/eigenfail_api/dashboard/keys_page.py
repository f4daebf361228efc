"""The pages of keys, of the audit log, and of signing in."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated
from urllib.parse import parse_qsl

import msgspec
from anyio.to_thread import run_sync
from fastapi import APIRouter, Depends, HTTPException, Query, Request
from fastapi.responses import HTMLResponse, RedirectResponse, Response
from markupsafe import Markup

from eigenfail.errors import Unauthorized
from eigenfail.values import Page
from eigenfail.values.access import ApiKey, AuditEntry, Quotas, Scope, Usage
from eigenfail_api.access import authentication
from eigenfail_api.access.middleware import append_change, describe_change
from eigenfail_api.dashboard.copying import format_curl, read_service
from eigenfail_api.dashboard.rendering import TEMPLATES, Badge, Pager, make_pager, page, write_time
from eigenfail_api.parameters import Before, Stored, read_within

router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)


VALID = Badge("valid", "✓", "good")
EXPIRED = Badge("expired", "○", "ended")
REVOKED = Badge("revoked", "×", "ended")

REFUSED = 400

LIMITS = {
    "max_open": "Max. open campaigns",
    "max_episodes": "Max. episodes per campaign",
    "max_episodes_per_day": "Max. episodes per 24 h",
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
    """A line of the audit log; `was_refused` marks a request that changed nothing."""

    at: str
    who: str
    did: str
    subject: str
    details: str
    address: str
    status: int
    was_refused: bool


class AuditView(msgspec.Struct, frozen=True, kw_only=True):
    """The page of the audit log."""

    lines: tuple[ChangeLine, ...]
    pages: Pager


def make_keys_view(
    listed: Page[ApiKey],
    usage: Mapping[int, Usage],
    before: int | None,
    at_ms: int,
    *,
    is_locked: bool,
) -> KeysView:
    """Return the page of keys at a time."""
    return KeysView(
        lines=tuple(make_key_line(key, usage[key.id], at_ms) for key in listed.items),
        pages=make_pager("/keys", before, listed.next),
        is_locked=is_locked,
        limits=tuple(LIMITS.items()),
    )


def make_key_line(key: ApiKey, usage: Usage, at_ms: int) -> KeyLine:
    """Return the line of a key."""
    return KeyLine(
        id=key.id,
        name=key.name,
        scope=key.scope,
        badge=make_badge(key, at_ms),
        made=write_time(key.created_ms),
        used=write_time(key.last_used_ms),
        quotas=tuple(list_quotas(key.quotas, usage)),
        limits=tuple((name, words, getattr(key.quotas, name)) for name, words in LIMITS.items()),
        ends=write_time(key.revoked_ms or key.expires_ms),
        can_revoke=key.is_valid(at_ms),
    )


def list_quotas(given: Quotas, usage: Usage) -> Iterator[str]:
    """Return each quota of a key with its usage."""
    if given.max_open is not None:
        yield f"{usage.open:,} of {given.max_open:,} campaigns open"
    if given.max_episodes is not None:
        yield f"{given.max_episodes:,} episodes per campaign"
    if given.max_episodes_per_day is not None:
        yield f"{usage.episodes_of_day:,} of {given.max_episodes_per_day:,} episodes in 24 h"


def make_badge(key: ApiKey, at_ms: int) -> Badge:
    """Return the badge that says whether a key is valid, and why not."""
    if key.is_valid(at_ms):
        return VALID
    return REVOKED if key.revoked_ms else EXPIRED


def make_audit_view(listed: Page[AuditEntry], before: int | None) -> AuditView:
    """Return the page of the audit log."""
    return AuditView(
        lines=tuple(map(make_change_line, listed.items)),
        pages=make_pager("/audit", before, listed.next),
    )


def make_change_line(entry: AuditEntry) -> ChangeLine:
    """Return the line of an entry of the audit log."""
    return ChangeLine(
        at=write_time(entry.at_ms),
        who=entry.who if entry.key is None else f"{entry.who} ({entry.key})",
        did=f"{entry.method} {entry.route}",
        subject=entry.subject,
        details=entry.details,
        address=entry.address,
        status=entry.status,
        was_refused=entry.status >= REFUSED,
    )


KEYS_ON_A_PAGE = 50
CHANGES_ON_A_PAGE = 100


@router.get("/keys")
def show_keys(
    request: Request,
    store: Stored,
    authenticator: Annotated[
        authentication.Authenticator, Depends(authentication.authenticator_of)
    ],
    before: Before = None,
) -> HTMLResponse:
    """Keys, the form for a new one, and a button that revokes each."""
    listed = store.keys.page(KEYS_ON_A_PAGE, before)
    usage = store.keys.usage([key.id for key in listed.items])
    view = make_keys_view(
        listed, usage, before, authenticator.clock(), is_locked=authenticator.requires_keys()
    )
    body = {"name": "ci", "scope": "runner"}
    return page("keys.html", view, curl=format_curl(read_service(request), "/keys", body))


@router.get("/audit")
def show_changes(store: Stored, before: Before = None) -> HTMLResponse:
    """The audit log."""
    return page("audit.html", make_audit_view(store.audit.page(CHANGES_ON_A_PAGE, before), before))


@dataclass(frozen=True)
class LoginView:
    """The login form, with the error of the last attempt.

    Attributes:
        wanted: the address that comes next.
        needs_key: whether there is anything to sign in to.
        problem: problem of the last attempt.
    """

    wanted: str
    needs_key: bool = True
    problem: str = ""


HOME, LOGIN = "/", "/login"
MOST_FIELDS = 10


Wanted = Annotated[str, Query(alias="next", max_length=2_000)]
TheAuthenticator = Annotated[authentication.Authenticator, Depends(authentication.authenticator_of)]


def disable_without_scope(needed: str) -> Markup:
    """Return the attributes that disable a button if the key's scope is too low."""
    caller = authentication.find_caller_without(Scope(needed))
    if caller is None:
        return Markup()
    why = (
        f"This needs a key with scope '{needed}'; {caller.description} has scope '{caller.scope}'."
    )
    return Markup(' disabled title="{}"').format(why)


# The line at the head of every page: who is signed in, and which actions their scope lacks.
TEMPLATES.globals |= {
    "signed_in": authentication.get_signed_in_caller,
    "withheld": disable_without_scope,
}


@router.get(LOGIN)
def show_login(authenticator: TheAuthenticator, wanted: Wanted = HOME) -> HTMLResponse:
    """The form for a key."""
    return page(
        "login.html", LoginView(keep_own_address(wanted), needs_key=authenticator.requires_keys())
    )


@router.post(LOGIN)
async def sign_in(request: Request, store: Stored, authenticator: TheAuthenticator) -> Response:
    """A cookie for a key; the key itself is kept nowhere."""
    fields = read_form(await read_within(request))
    wanted, token = keep_own_address(fields.get("next", HOME)), fields.get("key", "").strip()
    try:
        key = await run_sync(authenticator.verify_token, token, authentication.address_of(request))
    except Unauthorized:
        return page("login.html", LoginView(wanted, problem="Invalid key."), 401)
    response = RedirectResponse(wanted, 303)
    set_cookie(request, response, authenticator.sessions.open(key.id, authenticator.clock()))
    change = describe_change(request, authentication.caller_of_key(key), LOGIN, 303)
    await run_sync(append_change, store, change)
    return response


def set_cookie(request: Request, response: Response, word: str) -> None:
    """No script can read it, and no other site can have it sent."""
    secure = request.url.scheme == "https"
    response.set_cookie(
        authentication.SESSION_COOKIE,
        word,
        max_age=authentication.SESSION_S,
        httponly=True,
        samesite="strict",
        secure=secure,
    )


@router.post("/logout")
async def sign_out(request: Request, authenticator: TheAuthenticator) -> Response:
    """The cookie stands for nothing any more."""
    authenticator.sessions.close(request.cookies.get(authentication.SESSION_COOKIE, ""))
    response = RedirectResponse(LOGIN, 303)
    response.delete_cookie(authentication.SESSION_COOKIE, httponly=True, samesite="strict")
    return response


def read_form(body: bytes) -> dict[str, str]:
    """Return the fields of a form.

    Raises:
        HTTPException: 400, it is none.
    """
    try:
        return dict(parse_qsl(body.decode(), max_num_fields=MOST_FIELDS))
    except ValueError:
        raise HTTPException(400, "The form is invalid.") from None


def keep_own_address(wanted: str) -> str:
    """Return an address within this service; the first page instead of any other."""
    is_own = wanted.startswith("/") and not wanted.startswith("//")
    return wanted if is_own and wanted.isprintable() and "\\" not in wanted else HOME
