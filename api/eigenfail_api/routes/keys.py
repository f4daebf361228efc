"""Keys: made, listed, revoked; and the audit log of who changed what."""

from typing import Annotated

from fastapi import APIRouter, Depends, Path, Request

from eigenfail.values import Page
from eigenfail.values.access import ApiKey, AuditEntry, KeyRequest, NewKey
from eigenfail.values.quotas import Quotas, Usage
from eigenfail.wire.http import PREFIX
from eigenfail_api.access.door import Door
from eigenfail_api.bodies import Json, body_of
from eigenfail_api.parameters import LARGEST, Before, Limit, Stored
from eigenfail_api.schemas import documented
from eigenfail_services.access import keys

router = APIRouter(prefix=PREFIX, tags=["keys"])

KeyId = Annotated[int, Path(ge=1, le=LARGEST, description="Id of a key.")]


async def door_of(request: Request) -> Door:
    """Who knows whether a key is needed."""
    door: Door = request.app.state.door
    return door


@router.post("/keys", **documented(NewKey, 201, body=KeyRequest))
def create_key(
    store: Stored,
    door: Annotated[Door, Depends(door_of)],
    request: Annotated[KeyRequest, Depends(body_of(KeyRequest))],
) -> Json:
    """Make a key; its token is in this answer, and can never be read again."""
    made = keys.make_key(store, request)
    door.look_again()
    headers = {"Location": f"{PREFIX}/keys/{made.key.id}", "Cache-Control": "no-store"}
    return Json(made, 201, headers)


@router.get("/keys", **documented(Page[ApiKey]))
def list_keys(store: Stored, limit: Limit = 50, before: Before = None) -> Json:
    """Keys, newest first; those that are no longer valid, too."""
    return Json(store.keys.page(limit, before))


@router.get("/keys/{key}", **documented(ApiKey))
def get_key(store: Stored, key: KeyId) -> Json:
    """A key, without its secret."""
    return Json(store.keys.find(key).key)


@router.get("/keys/{key}/usage", **documented(Usage))
def get_usage(store: Stored, key: KeyId) -> Json:
    """What the campaigns of a key use of its quotas now."""
    found = store.keys.find(key).key
    return Json(store.keys.usage([found.id])[found.id])


@router.post("/keys/{key}/quotas", **documented(ApiKey, body=Quotas))
def limit_key(
    store: Stored, key: KeyId, quotas: Annotated[Quotas, Depends(body_of(Quotas))]
) -> Json:
    """Give a key these quotas from now on; what was made before stays, and counts."""
    return Json(store.keys.limit(key, quotas))


@router.delete("/keys/{key}", **documented(ApiKey))
def revoke_key(store: Stored, key: KeyId) -> Json:
    """Revoke a key, for good; what it did stays in the audit log under its name."""
    return Json(keys.revoke_key(store, key))


@router.get("/audit", **documented(Page[AuditEntry]))
def list_changes(store: Stored, limit: Limit = 50, before: Before = None) -> Json:
    """Who changed what, newest first."""
    return Json(store.audit.page(limit, before))
