"""Routes of saved views."""

from typing import Annotated

from fastapi import APIRouter, Depends, Path, Query

from eigenfail.values import Page
from eigenfail.views import (
    SavedView,
    ViewName,
    ViewPage,
    ViewRequest,
    check_view,
    check_view_name,
)
from eigenfail.wire.http import PREFIX
from eigenfail_api.openapi import document_route
from eigenfail_api.parameters import LARGEST, Before, CallerName, Json, Limit, Stored, body_of

router = APIRouter(prefix=f"{PREFIX}/views", tags=["views"])

ViewId = Annotated[int, Path(ge=1, le=LARGEST, description="Id of a view.")]
OfPage = Annotated[ViewPage | None, Query(description="Only views of this list.")]
Named = Annotated[str | None, Query(description="Only the view with this name.")]
Wanted = Annotated[ViewRequest, Depends(body_of(ViewRequest))]

WantedName = Annotated[ViewName, Depends(body_of(ViewName))]


@router.post("", **document_route(SavedView, 201, body=ViewRequest))
def create_view(store: Stored, wanted: Wanted, who: CallerName) -> Json:
    """Save a view of a list under a new name."""
    made = store.views.create(check_view(wanted), who)
    return Json(made, 201, {"Location": f"{PREFIX}/views/{made.id}"})


@router.get("", **document_route(Page[SavedView]))
def list_views(
    store: Stored,
    page: OfPage = None,
    name: Named = None,
    limit: Limit = 50,
    before: Before = None,
) -> Json:
    """List saved views, newest first."""
    return Json(store.views.page(limit, before, page, name))


@router.get("/{view}", **document_route(SavedView))
def get_view(store: Stored, view: ViewId) -> Json:
    """Get a saved view."""
    return Json(store.views.get(view))


@router.put("/{view}", **document_route(SavedView, body=ViewRequest))
def change_view(store: Stored, view: ViewId, wanted: Wanted, who: CallerName) -> Json:
    """Replace name, list and parameters of a saved view."""
    return Json(store.views.change(view, check_view(wanted), who))


@router.put("/{view}/name", **document_route(SavedView, body=ViewName))
def rename_view(store: Stored, view: ViewId, wanted: WantedName, who: CallerName) -> Json:
    """Give a saved view another name, without a change of its list and parameters."""
    return Json(store.views.rename(view, check_view_name(wanted.name), who))


@router.delete("/{view}", **document_route(SavedView))
def delete_view(store: Stored, view: ViewId) -> Json:
    """Delete a saved view; what it lists stays."""
    return Json(store.views.delete(view))
