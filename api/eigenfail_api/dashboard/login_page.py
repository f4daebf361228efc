"""The addresses at which a browser shows a key once, and gets a cookie for it."""

from typing import Annotated
from urllib.parse import parse_qsl

from anyio.to_thread import run_sync
from fastapi import APIRouter, Depends, HTTPException, Query, Request
from fastapi.responses import HTMLResponse, RedirectResponse, Response
from markupsafe import Markup

from eigenfail.errors import Unauthorized
from eigenfail.values.access import Scope
from eigenfail_api.access.callers import by_key, lacking, signed_in
from eigenfail_api.access.door import Door, address_of
from eigenfail_api.access.record import change, record
from eigenfail_api.access.sessions import COOKIE, LIFE_S
from eigenfail_api.bodies import read_within
from eigenfail_api.dashboard.rendering import TEMPLATES, page
from eigenfail_api.dashboard.views.login import LoginView
from eigenfail_api.parameters import Stored
from eigenfail_api.routes.keys import door_of

router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

HOME, LOGIN = "/", "/login"
MOST_FIELDS = 10


Wanted = Annotated[str, Query(alias="next", max_length=2_000)]
TheDoor = Annotated[Door, Depends(door_of)]


def withheld(needed: str) -> Markup:
    """Attributes of a button: whoever's key allows too little cannot press it, and reads why."""
    caller = lacking(Scope(needed))
    if caller is None:
        return Markup()
    why = f"This needs a key of the scope '{needed}'; that of '{caller.name}' is '{caller.scope}'."
    return Markup(' disabled title="{}"').format(why)


# The line at the head of every page that says who is signed in, and what is not theirs to press.
TEMPLATES.globals |= {"signed_in": signed_in, "withheld": withheld}


@router.get(LOGIN)
def show_login(door: TheDoor, wanted: Wanted = HOME) -> HTMLResponse:
    """The form for a key."""
    return page("login.html", LoginView(own(wanted), needs_key=door.is_locked()))


@router.post(LOGIN)
async def sign_in(request: Request, store: Stored, door: TheDoor) -> Response:
    """A cookie for a key; the key itself is kept nowhere."""
    fields = form_of(await read_within(request))
    wanted, token = own(fields.get("next", HOME)), fields.get("key", "").strip()
    try:
        key = await run_sync(door.holder, token, address_of(request))
    except Unauthorized:
        return page("login.html", LoginView(wanted, problem="That key is not valid here."), 401)
    response = RedirectResponse(wanted, 303)
    set_cookie(request, response, door.sessions.open(key.id, door.clock()))
    await run_sync(record, store, change(request, by_key(key), LOGIN, 303))
    return response


def set_cookie(request: Request, response: Response, word: str) -> None:
    """No script can read it, and no other site can have it sent."""
    secure = request.url.scheme == "https"
    response.set_cookie(
        COOKIE, word, max_age=LIFE_S, httponly=True, samesite="strict", secure=secure
    )


@router.post("/logout")
async def sign_out(request: Request, door: TheDoor) -> Response:
    """The cookie stands for nothing any more."""
    door.sessions.close(request.cookies.get(COOKIE, ""))
    response = RedirectResponse(LOGIN, 303)
    response.delete_cookie(COOKIE, httponly=True, samesite="strict")
    return response


def form_of(body: bytes) -> dict[str, str]:
    """The fields of a form.

    Raises:
        HTTPException: 400, it is none.
    """
    try:
        return dict(parse_qsl(body.decode(), max_num_fields=MOST_FIELDS))
    except ValueError:
        raise HTTPException(400, "The form cannot be read.") from None


def own(wanted: str) -> str:
    """An address of this service, without its name; the first page instead of any other."""
    is_own = wanted.startswith("/") and not wanted.startswith("//")
    return wanted if is_own and wanted.isprintable() and "\\" not in wanted else HOME
