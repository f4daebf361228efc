"""For those who operate the service: is it alive, is it ready, how is it doing."""

from fastapi import APIRouter, Request
from fastapi.responses import PlainTextResponse
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest

from eigenfail.wire.http import Health
from eigenfail_api.bodies import Json
from eigenfail_api.parameters import Stored
from eigenfail_api.schemas import documented

router = APIRouter(tags=["operations"])


@router.get("/healthz", **documented(Health))
def get_health() -> Json:
    """The process lives."""
    return Json(Health())


@router.get("/readyz", **documented(Health))
def get_readiness(store: Stored) -> Json:
    """The process lives, and the service can read its database and write to it."""
    store.ping()
    return Json(Health())


@router.get("/metrics", response_class=PlainTextResponse)
def get_metrics(request: Request) -> PlainTextResponse:
    """Figures for Prometheus."""
    text = generate_latest(request.app.state.registry)
    return PlainTextResponse(text, media_type=CONTENT_TYPE_LATEST)
