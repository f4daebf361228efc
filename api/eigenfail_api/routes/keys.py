"""Routes of API keys and of the audit log."""

from typing import Annotated

from fastapi import APIRouter, Depends, Path

from eigenfail.values.access import ApiKey, AuditEntry, KeyRequest, NewKey, Quotas, Usage
from eigenfail.values.records import Page
from eigenfail.wire.http import PREFIX
from eigenfail_api.access.authentication import Authenticator, authenticator_of
from eigenfail_api.openapi import document_route
from eigenfail_api.parameters import LARGEST, Before, Json, Limit, Stored, body_of
from eigenfail_services import access

router = APIRouter(prefix=PREFIX, tags=["keys"])

KeyId = Annotated[int, Path(ge=1, le=LARGEST, description="Id of a key.")]


EXAMPLE = {"name": "nightly pipeline", "scope": "runner", "expires_s": 7_776_000}


@router.post("/keys", **document_route(NewKey, 201, body=KeyRequest, example=EXAMPLE))
def create_key(
    store: Stored,
    authenticator: Annotated[Authenticator, Depends(authenticator_of)],
    request: Annotated[KeyRequest, Depends(body_of(KeyRequest))],
) -> Json:
    """Create a key. Its token is in this answer and cannot be read again."""
    made = access.make_key(store, request)
    # The first key must be required from the next request on, and not only after the last check is
    # a second old.
    authenticator.note_new_key()
    # The answer has the only copy of the token, which no cache may keep.
    headers = {"Location": f"{PREFIX}/keys/{made.key.id}", "Cache-Control": "no-store"}
    return Json(made, 201, headers)


@router.get("/keys", **document_route(Page[ApiKey]))
def list_keys(store: Stored, limit: Limit = 50, before: Before = None) -> Json:
    """List keys, newest first, including revoked and expired ones."""
    return Json(store.keys.page(limit, before))


@router.get("/keys/{key}", **document_route(ApiKey))
def get_key(store: Stored, key: KeyId) -> Json:
    """Get a key, without its secret."""
    return Json(store.keys.find(key).key)


@router.get("/keys/{key}/usage", **document_route(Usage))
def get_usage(store: Stored, key: KeyId) -> Json:
    """Get the current use of a key's quotas by its campaigns."""
    found = store.keys.find(key).key
    return Json(store.keys.usage([found.id])[found.id])


@router.post("/keys/{key}/quotas", **document_route(ApiKey, body=Quotas))
def limit_key(
    store: Stored, key: KeyId, quotas: Annotated[Quotas, Depends(body_of(Quotas))]
) -> Json:
    """Set the quotas of a key. Existing campaigns stay and count."""
    return Json(store.keys.limit(key, quotas))


@router.delete("/keys/{key}", **document_route(ApiKey))
def revoke_key(store: Stored, key: KeyId) -> Json:
    """Revoke a key permanently. Its entries in the audit log stay."""
    return Json(access.revoke_key(store, key))


@router.get("/audit", **document_route(Page[AuditEntry]))
def list_changes(store: Stored, limit: Limit = 50, before: Before = None) -> Json:
    """List the changes that callers made, newest first."""
    return Json(store.audit.page(limit, before))
