"""The addresses of the form that launches campaigns."""

from collections.abc import Mapping
from typing import Any
from urllib.parse import parse_qsl
from uuid import NAMESPACE_URL, uuid4, uuid5

import msgspec
from anyio.to_thread import run_sync
from fastapi import APIRouter, HTTPException, Request
from fastapi.responses import HTMLResponse

from eigenfail.contracts import Store
from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.values import Campaign, CampaignSpec
from eigenfail_api.bodies import read_within
from eigenfail_api.dashboard.rendering import page
from eigenfail_api.dashboard.views.copying import Asked, Service, copies, service_of
from eigenfail_api.dashboard.views.launch import (
    LaunchView,
    checked_words,
    fields_of,
    leaves,
    origin_of,
    shown_fields,
    troubles_of,
)
from eigenfail_api.dashboard.views.launch_entries import Texts, body_of
from eigenfail_api.dashboard.views.launch_layout import layout
from eigenfail_api.parameters import LARGEST, Stored
from eigenfail_services.campaigns.clones import changed
from eigenfail_services.campaigns.drafts import COMPANIONS, completed, problems_of, read_draft

router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

FROM, WISH, TOKEN = "from", "wish", "token"
MOST_FIELDS = 2_000
KNOWN = frozenset({FROM, WISH, TOKEN, *CampaignSpec.__struct_fields__})


@router.get("/launch")
def show_launch(request: Request, store: Stored) -> HTMLResponse:
    """The form: empty, or as its address says; `from` begins with an earlier campaign."""
    return page("launch.html", launch_view(store, dict(request.query_params), service_of(request)))


@router.post("/launch/form")
async def show_form(request: Request, store: Stored) -> HTMLResponse:
    """The form for what was typed so far, checked if that is wished; nothing is launched."""
    body = await read_within(request)
    try:
        pairs = parse_qsl(body.decode(), keep_blank_values=True, max_num_fields=MOST_FIELDS)
    except ValueError as error:
        raise HTTPException(400, f"The form cannot be read: {error}.") from None
    view = await run_sync(launch_view, store, dict(pairs), service_of(request))
    return page("launch.html", view)


def launch_view(store: Store, typed: Mapping[str, str], service: Service) -> LaunchView:
    """The form for what was typed, in a service at that address.

    Raises:
        UnknownName: something was typed that no campaign has.
        InvalidValue: the earlier campaign is no number.
        NotFound: there is no such campaign.
    """
    refuse_strangers(typed)
    origin = origin_in(store, typed)
    texts = Texts(typed, base_of(origin, typed))
    parts = layout(texts)
    fields = fields_of(parts)
    body = body_of(fields, texts)
    wished = typed.get(WISH, "") != ""
    problems = problems_of(body, store) if wished else ()
    troubles = troubles_of(problems, fields)
    in_order = wished and not problems
    token = typed.get(TOKEN, "") or str(uuid4())
    return LaunchView(
        parts=parts,
        shown=shown_fields(fields, texts, troubles, origin),
        troubles=troubles,
        origin=origin_of(origin, body) if origin else None,
        body=body,
        checked=checked_words(body) if in_order else "",
        completed=whole(body, store) if in_order else (),
        key=key_of(token, body) if in_order else "",
        token=token,
        copies=copies(service, Asked(method="POST", path="/campaigns", body=body))
        if in_order
        else None,
    )


def refuse_strangers(typed: Mapping[str, str]) -> None:
    """Raises UnknownName for what belongs to no field of a campaign."""
    for name in typed:
        if name.partition(".")[0] not in KNOWN:
            raise UnknownName("query", name[:100], KNOWN)


def origin_in(store: Store, typed: Mapping[str, str]) -> Campaign | None:
    """The campaign that the form begins with.

    Raises:
        InvalidValue: what is named is no id.
        NotFound: there is no such campaign.
    """
    named = typed.get(FROM, "")
    if not named:
        return None
    if not (named.isascii() and named.isdecimal() and 1 <= int(named[:30]) <= LARGEST):
        raise InvalidValue(FROM, f"'{named[:100]}' is no id of a campaign.", "Give a number.")
    return store.campaigns.get(int(named))


def base_of(origin: Campaign | None, typed: Mapping[str, str]) -> dict[str, Any]:
    """The fields that the form begins with; settings of a plug-in that was replaced are gone."""
    if origin is None:
        return {}
    chosen = {name: typed[name] for name in COMPANIONS if typed.get(name)}
    return changed(msgspec.to_builtins(origin.spec), chosen)


def whole(body: Mapping[str, Any], store: Store) -> tuple[tuple[str, str], ...]:
    """All that a campaign would be, by path."""
    return tuple(leaves(msgspec.to_builtins(completed(read_draft(body, store)))))


def key_of(token: str, body: Mapping[str, Any]) -> str:
    """A second click on one page has the same key; with other fields it has another."""
    plain = msgspec.json.encode(body, order="sorted").decode()
    return str(uuid5(NAMESPACE_URL, f"{token} {plain}"))
