"""The pages of keys, of the audit log, and of signing in."""

from collections.abc import Iterator
from typing import Annotated

from anyio.to_thread import run_sync
from fastapi import APIRouter, Depends, Query, Request
from fastapi.responses import HTMLResponse, RedirectResponse, Response
from markupsafe import Markup

from eigenfail.errors import Unauthorized
from eigenfail.values.access import KeyState, Quotas, Scope, Usage
from eigenfail_api.access import authentication
from eigenfail_api.access.middleware import append_change, describe_change
from eigenfail_api.dashboard.copying import format_curl, read_service
from eigenfail_api.dashboard.rendering import TEMPLATES, Badge, make_pager, page
from eigenfail_api.parameters import Before, Stored, read_form

router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)


STATES = {
    KeyState.VALID: Badge("valid", "✓", "good"),
    KeyState.EXPIRED: Badge("expired", "○", "ended"),
    KeyState.REVOKED: Badge("revoked", "×", "ended"),
}

LIMITS = {
    "max_open": "Max. open campaigns",
    "max_episodes": "Max. episodes per campaign",
    "max_episodes_per_day": "Max. episodes per 24 h",
}


def list_quotas(given: Quotas, usage: Usage) -> Iterator[str]:
    """Return each quota of a key with its usage."""
    if given.max_open is not None:
        yield f"{usage.open:,} of {given.max_open:,} campaigns open"
    if given.max_episodes is not None:
        yield f"{given.max_episodes:,} episodes per campaign"
    if given.max_episodes_per_day is not None:
        yield f"{usage.episodes_of_day:,} of {given.max_episodes_per_day:,} episodes in 24 h"


TheAuthenticator = Annotated[authentication.Authenticator, Depends(authentication.authenticator_of)]

KEYS_ON_A_PAGE = 50
CHANGES_ON_A_PAGE = 100


@router.get("/keys")
def show_keys(
    request: Request,
    store: Stored,
    authenticator: TheAuthenticator,
    before: Before = None,
) -> HTMLResponse:
    """Show the keys, the form for a new one, and a button that revokes each."""
    listed = store.keys.page(KEYS_ON_A_PAGE, before)
    usage = store.keys.usage([key.id for key in listed.items])
    quotas = {key.id: tuple(list_quotas(key.quotas, usage[key.id])) for key in listed.items}
    at_ms = authenticator.clock()
    body = {"name": "ci", "scope": "runner"}
    return page(
        "keys.html",
        [(key, STATES[key.find_state(at_ms)], quotas[key.id]) for key in listed.items],
        pages=make_pager("/keys", before, listed.next),
        is_locked=authenticator.requires_keys(),
        limits=LIMITS,
        curl=format_curl(read_service(request), "/keys", body),
    )


@router.get("/audit")
def show_changes(store: Stored, before: Before = None) -> HTMLResponse:
    """Show the audit log."""
    listed = store.audit.page(CHANGES_ON_A_PAGE, before)
    return page("audit.html", listed, pages=make_pager("/audit", before, listed.next))


HOME, LOGIN = "/", "/login"


Wanted = Annotated[str, Query(alias="next", max_length=2_000)]


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
    """Show the form that takes a key."""
    needs_key = authenticator.requires_keys()
    return page("login.html", keep_own_address(wanted), needs_key=needs_key, problem="")


@router.post(LOGIN)
async def sign_in(request: Request, store: Stored, authenticator: TheAuthenticator) -> Response:
    """Set a cookie in exchange for a key; the key itself is kept nowhere."""
    # The form has two fields; a body of thousands is not read to its end.
    fields = await read_form(request, 10)
    wanted, token = keep_own_address(fields.get("next", HOME)), fields.get("key", "").strip()
    try:
        key = await run_sync(authenticator.verify_token, token, authentication.address_of(request))
    except Unauthorized:
        return page("login.html", wanted, 401, needs_key=True, problem="Invalid key.")
    response = RedirectResponse(wanted, 303)
    set_cookie(request, response, authenticator.sessions.open(key.id, authenticator.clock()))
    change = describe_change(request, authentication.caller_of_key(key), LOGIN, 303)
    await run_sync(append_change, store, change)
    return response


def set_cookie(request: Request, response: Response, word: str) -> None:
    """Set the cookie of a session, which no script can read and no other site can send."""
    # A secure cookie would not come back over plain HTTP on this machine.
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
    """End the session of the cookie, and delete the cookie."""
    authenticator.sessions.close(request.cookies.get(authentication.SESSION_COOKIE, ""))
    response = RedirectResponse(LOGIN, 303)
    response.delete_cookie(authentication.SESSION_COOKIE, httponly=True, samesite="strict")
    return response


def keep_own_address(wanted: str) -> str:
    """Return an address within this service; the first page instead of any other."""
    # Two slashes begin the address of another host.
    is_own = wanted.startswith("/") and not wanted.startswith("//")
    return wanted if is_own and wanted.isprintable() and "\\" not in wanted else HOME
