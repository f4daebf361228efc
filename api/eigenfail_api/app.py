"""The API as an ASGI application."""

from fastapi import Depends, FastAPI
from prometheus_client import CollectorRegistry

from eigenfail import __version__
from eigenfail.contracts import Store
from eigenfail_api import metrics, schemas
from eigenfail_api.dashboard import comparison_page, pages
from eigenfail_api.dashboard.problems import for_browsers
from eigenfail_api.dashboard.rendering import STATIC, Assets
from eigenfail_api.feed import Feed
from eigenfail_api.guard import Guard
from eigenfail_api.headers import SecurityHeaders
from eigenfail_api.parameters import refuse_unknown_parameters
from eigenfail_api.problems import HANDLERS
from eigenfail_api.routes import (
    analyses,
    campaigns,
    comparisons,
    costs,
    episodes,
    events,
    operations,
    plugins,
    reports,
    safety,
)
from eigenfail_api.settings import ApiSettings, refuse_open_door

# Safety is before campaigns, whose /{campaign} would take /region for an id.
ROUTERS = (
    safety.router,
    costs.router,
    campaigns.router,
    episodes.router,
    analyses.router,
    comparisons.router,
    reports.router,
    events.router,
    plugins.router,
    operations.router,
    pages.router,
    comparison_page.router,
)


def create_app(store: Store, settings: ApiSettings) -> FastAPI:
    """The application over a store that is open; who opened it closes it.

    Raises:
        InvalidValue: the settings would let strangers in.
    """
    refuse_open_door(settings)
    app = FastAPI(
        title="eigenfail",
        version=__version__,
        summary="Finds the rare failures of driving stacks, groups, replays and prices them.",
        docs_url=None,
        redoc_url=None,
        default_response_class=schemas.Json,
        exception_handlers=for_browsers(HANDLERS),
        generate_unique_id_function=lambda route: route.name,
    )
    app.state.store = store
    app.state.settings = settings
    app.state.feed = Feed(store, settings.poll_s)
    app.state.registry = CollectorRegistry()
    app.state.registry.register(metrics.Campaigns(store))
    for router in ROUTERS:
        app.include_router(router, dependencies=[Depends(refuse_unknown_parameters)])
    app.mount("/static", Assets(directory=STATIC), name="static")
    app.openapi = lambda: schemas.openapi(app)  # type: ignore[method-assign]  # FastAPI's own way
    # The last one added is the first one asked.
    app.add_middleware(Guard, hosts=settings.hosts if settings.is_private else None)
    app.add_middleware(metrics.Requests, registry=app.state.registry)
    app.add_middleware(SecurityHeaders)
    return app
