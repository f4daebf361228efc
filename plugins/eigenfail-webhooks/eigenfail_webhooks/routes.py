"""Routes of webhooks: all require an administrator, for addresses may hold secrets."""

from typing import Annotated

from fastapi import APIRouter, Depends, Path

from eigenfail.values.access import Scope
from eigenfail.values.records import Page
from eigenfail.wire.http import PREFIX
from eigenfail_api.extensions import Extension
from eigenfail_api.openapi import document_route
from eigenfail_api.parameters import LARGEST, Before, Json, Limit, Stored, body_of
from eigenfail_webhooks.addresses import check_url
from eigenfail_webhooks.signatures import make_secret
from eigenfail_webhooks.store import WebhookStore
from eigenfail_webhooks.values import NewWebhook, Webhook, WebhookDelivery, WebhookRequest

router = APIRouter(prefix=PREFIX, tags=["events"])

WebhookId = Annotated[int, Path(ge=1, le=LARGEST, description="Id of a webhook.")]


EXAMPLE = {
    "url": "https://hooks.example.org/eigenfail",
    "events": ["campaign.ended", "gate.failed"],
}


@router.post("/webhooks", **document_route(NewWebhook, 201, body=WebhookRequest, example=EXAMPLE))
def create_webhook(
    store: Stored, request: Annotated[WebhookRequest, Depends(body_of(WebhookRequest))]
) -> Json:
    """Create a webhook. Its secret is in this answer and cannot be read again."""
    # Where the name leads is judged at each delivery, since it may lead elsewhere by then.
    check_url(request.url)
    secret = make_secret()
    made = NewWebhook(WebhookStore(store.database).create(request, secret), secret)
    # The answer shows the secret for the only time, and no cache may keep it.
    headers = {"Location": f"{PREFIX}/webhooks/{made.webhook.id}", "Cache-Control": "no-store"}
    return Json(made, 201, headers)


@router.get("/webhooks", **document_route(Page[Webhook]))
def list_webhooks(store: Stored, limit: Limit = 50, before: Before = None) -> Json:
    """List webhooks with their last deliveries, newest first, without their secrets."""
    return Json(WebhookStore(store.database).page(limit, before))


@router.get("/webhooks/{webhook}", **document_route(Webhook))
def get_webhook(store: Stored, webhook: WebhookId) -> Json:
    """Get a webhook with its last deliveries, without its secret."""
    return Json(WebhookStore(store.database).get(webhook))


@router.delete("/webhooks/{webhook}", **document_route(Webhook))
def delete_webhook(store: Stored, webhook: WebhookId) -> Json:
    """Delete a webhook, with its secret and its deliveries."""
    return Json(WebhookStore(store.database).delete(webhook))


@router.post("/webhooks/{webhook}/test", **document_route(WebhookDelivery, 202))
def send_test_event(store: Stored, webhook: WebhookId) -> Json:
    """Queue a test event for a webhook. The webhook at `Location` says what became of it."""
    queued = WebhookStore(store.database).test(webhook)
    return Json(queued, 202, {"Location": f"{PREFIX}/webhooks/{webhook}"})


extension = Extension(
    routers=(router,),
    scopes={Scope.ADMIN: (f"GET {PREFIX}/webhooks", f"GET {PREFIX}/webhooks/{{webhook}}")},
    recorded={WebhookRequest: ("events",)},
)
