"""The addresses at which an administrator sees who has a key, and who changed what."""

from typing import Annotated

from fastapi import APIRouter, Depends, Request
from fastapi.responses import HTMLResponse

from eigenfail_api.access.door import Door
from eigenfail_api.dashboard.rendering import page
from eigenfail_api.dashboard.views.copying import Asked, copies, service_of
from eigenfail_api.dashboard.views.keys import audit_view, keys_view
from eigenfail_api.parameters import Before, Stored
from eigenfail_api.routes.keys import door_of

router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

KEYS_ON_A_PAGE = 50
CHANGES_ON_A_PAGE = 100


@router.get("/keys")
def show_keys(
    request: Request,
    store: Stored,
    door: Annotated[Door, Depends(door_of)],
    before: Before = None,
) -> HTMLResponse:
    """Keys, the form for a new one, and a button that revokes each."""
    listed = store.keys.page(KEYS_ON_A_PAGE, before)
    usage = store.keys.usage([key.id for key in listed.items])
    view = keys_view(listed, usage, before, door.clock(), is_locked=door.is_locked())
    asked = Asked(method="POST", path="/keys", body={"name": "ci", "scope": "runner"})
    return page("keys.html", view, copies=copies(service_of(request), asked))


@router.get("/audit")
def show_changes(store: Stored, before: Before = None) -> HTMLResponse:
    """The audit log."""
    return page("audit.html", audit_view(store.audit.page(CHANGES_ON_A_PAGE, before), before))
