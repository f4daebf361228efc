"""Routes of webhooks and their deliveries."""

from typing import Annotated

from fastapi import APIRouter, Depends, Path, Query

from eigenfail.signatures import make_secret
from eigenfail.values import Page
from eigenfail.values.webhooks import (
    DeliveryState,
    NewWebhook,
    Webhook,
    WebhookDelivery,
    WebhookRequest,
)
from eigenfail.wire.http import PREFIX
from eigenfail_api.openapi import document_route
from eigenfail_api.parameters import LARGEST, Before, Json, Limit, Stored, body_of
from eigenfail_services.webhooks.addresses import check_url

router = APIRouter(prefix=PREFIX, tags=["webhooks"])

WebhookId = Annotated[int, Path(ge=1, le=LARGEST, description="Id of a webhook.")]
DeliveryId = Annotated[int, Path(ge=1, le=LARGEST, description="Id of a delivery.")]
State = Annotated[DeliveryState | None, Query(description="Only deliveries in this state.")]


@router.post("/webhooks", **document_route(NewWebhook, 201, body=WebhookRequest))
def create_webhook(
    store: Stored, request: Annotated[WebhookRequest, Depends(body_of(WebhookRequest))]
) -> Json:
    """Create a webhook. Its secret is in this answer and cannot be read again."""
    check_url(request.url)
    secret = make_secret()
    made = NewWebhook(store.webhooks.create(request, secret), secret)
    headers = {"Location": f"{PREFIX}/webhooks/{made.webhook.id}", "Cache-Control": "no-store"}
    return Json(made, 201, headers)


@router.get("/webhooks", **document_route(Page[Webhook]))
def list_webhooks(store: Stored, limit: Limit = 50, before: Before = None) -> Json:
    """List webhooks, newest first, without their secrets."""
    return Json(store.webhooks.page(limit, before))


@router.get("/webhooks/{webhook}", **document_route(Webhook))
def get_webhook(store: Stored, webhook: WebhookId) -> Json:
    """Get a webhook, without its secret."""
    return Json(store.webhooks.get(webhook))


@router.delete("/webhooks/{webhook}", **document_route(Webhook))
def delete_webhook(store: Stored, webhook: WebhookId) -> Json:
    """Delete a webhook, with its secret and its deliveries."""
    return Json(store.webhooks.delete(webhook))


@router.post("/webhooks/{webhook}/activate", **document_route(Webhook))
def activate_webhook(store: Stored, webhook: WebhookId) -> Json:
    """Send events to a webhook from now on, and the pending deliveries."""
    return Json(store.webhooks.set_active(webhook, active=True))


@router.post("/webhooks/{webhook}/deactivate", **document_route(Webhook))
def deactivate_webhook(store: Stored, webhook: WebhookId) -> Json:
    """Send nothing to a webhook from now on. Pending deliveries wait; new events are not kept."""
    return Json(store.webhooks.set_active(webhook, active=False))


@router.post("/webhooks/{webhook}/test", **document_route(WebhookDelivery, 202))
def send_test_event(store: Stored, webhook: WebhookId) -> Json:
    """Queue a test event for a webhook. The delivery at `Location` says what became of it."""
    return _answer_queued(store.webhooks.test(webhook))


@router.get("/webhooks/{webhook}/deliveries", **document_route(Page[WebhookDelivery]))
def list_deliveries(
    store: Stored,
    webhook: WebhookId,
    state: State = None,
    limit: Limit = 50,
    before: Before = None,
) -> Json:
    """List the deliveries of a webhook, newest first: pending, delivered and failed ones."""
    return Json(store.webhooks.deliveries(webhook, limit, before, state))


@router.get("/webhooks/{webhook}/deliveries/{delivery}", **document_route(WebhookDelivery))
def get_delivery(store: Stored, webhook: WebhookId, delivery: DeliveryId) -> Json:
    """Get a delivery of a webhook."""
    return Json(store.webhooks.get_delivery(webhook, delivery))


@router.post(
    "/webhooks/{webhook}/deliveries/{delivery}/redeliver", **document_route(WebhookDelivery, 202)
)
def redeliver_event(store: Stored, webhook: WebhookId, delivery: DeliveryId) -> Json:
    """Queue a delivery again, under the same event id."""
    return _answer_queued(store.webhooks.redeliver(webhook, delivery))


def _answer_queued(delivery: WebhookDelivery) -> Json:
    location = f"{PREFIX}/webhooks/{delivery.webhook}/deliveries/{delivery.id}"
    return Json(delivery, 202, {"Location": location})
