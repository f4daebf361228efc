"""The API as an ASGI application."""

from fastapi import Depends, FastAPI
from prometheus_client import CollectorRegistry

from eigenfail import __version__
from eigenfail.contracts import Store
from eigenfail_api import bodies, metrics, openapi
from eigenfail_api.access.door import Clock, Door
from eigenfail_api.access.gate import Gate
from eigenfail_api.access.secrets import redact_logs
from eigenfail_api.dashboard import (
    api_page,
    comparison_page,
    copies_page,
    episode_page,
    episodes_page,
    glossary_page,
    keys_page,
    launch_page,
    login_page,
    pages,
    suites_page,
)
from eigenfail_api.dashboard.problems import for_browsers
from eigenfail_api.dashboard.rendering import STATIC, Assets
from eigenfail_api.departures import Departures
from eigenfail_api.feed import Feed
from eigenfail_api.guard import Guard
from eigenfail_api.headers import SecurityHeaders
from eigenfail_api.parameters import (
    refuse_other_media,
    refuse_repeated_parameters,
    refuse_unknown_parameters,
)
from eigenfail_api.problems import HANDLERS
from eigenfail_api.routes import (
    analyses,
    campaigns,
    comparisons,
    costs,
    episodes,
    events,
    explanations,
    exports,
    keys,
    operations,
    plugins,
    policies,
    prunings,
    reports,
    safety,
    suites,
    workers,
)
from eigenfail_api.settings import ApiSettings, refuse_open_door, refuse_without_keys
from eigenfail_api.transfer import Etags, Heads
from eigenfail_services.exports.jobs import ExportJobs
from eigenfail_services.exports.shelf import folder_beside
from eigenfail_services.store.clock import now_ms

# Safety is before campaigns, whose /{campaign} would take /region for an id.
ROUTERS = (
    safety.router,
    costs.router,
    workers.router,
    policies.router,
    prunings.router,
    campaigns.router,
    suites.router,
    episodes.router,
    exports.router,
    explanations.router,
    analyses.router,
    comparisons.router,
    reports.router,
    events.router,
    plugins.router,
    operations.router,
    keys.router,
    login_page.router,
    keys_page.router,
    pages.router,
    episodes_page.router,
    episode_page.router,
    comparison_page.router,
    copies_page.router,
    suites_page.router,
    api_page.router,
    glossary_page.router,
)


def create_app(store: Store, settings: ApiSettings, clock: Clock = now_ms) -> FastAPI:
    """The application over a store that is open; who opened it closes it.

    Args:
        store: what is served.
        settings: how.
        clock: milliseconds since 1970, by which keys and sessions end.

    Raises:
        InvalidValue: the settings would let strangers in.
    """
    refuse_open_door(settings)
    refuse_without_keys(settings, store.keys)
    redact_logs()
    app = FastAPI(
        title="eigenfail",
        version=__version__,
        summary="Finds the rare failures of driving stacks, groups, replays and prices them.",
        docs_url=None,
        redoc_url=None,
        default_response_class=bodies.Json,
        exception_handlers=for_browsers(HANDLERS),
        generate_unique_id_function=lambda route: route.name,
    )
    app.state.store = store
    app.state.settings = settings
    app.state.door = Door(store, settings, clock)
    app.state.exports = ExportJobs(store, folder_beside(settings.database))
    app.state.feed = Feed(store, settings.poll_s)
    app.state.registry = CollectorRegistry()
    app.state.registry.register(metrics.Campaigns(store))
    refusers = (refuse_unknown_parameters, refuse_repeated_parameters, refuse_other_media)
    refused = [Depends(refuse) for refuse in refusers]
    for router in ROUTERS:
        app.include_router(router, dependencies=refused)
    # Its form has a parameter for every setting that a plug-in may have.
    app.include_router(launch_page.router)
    app.mount("/static", Assets(directory=STATIC), name="static")
    app.openapi = lambda: openapi.document_of(app)  # type: ignore[method-assign]  # FastAPI's own way
    # The last one added is the first one asked.
    app.add_middleware(Departures)
    app.add_middleware(Etags)
    app.add_middleware(Heads)
    app.add_middleware(Gate, door=app.state.door, store=store)
    app.add_middleware(Guard, hosts=settings.names)
    app.add_middleware(metrics.Requests, registry=app.state.registry)
    app.add_middleware(SecurityHeaders)
    return app
