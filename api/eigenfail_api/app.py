"""The API as an ASGI application."""

from collections.abc import Sequence
from functools import cache

from fastapi import APIRouter, Depends, FastAPI
from prometheus_client import CollectorRegistry
from starlette.routing import BaseRoute
from uvicorn.middleware.proxy_headers import ProxyHeadersMiddleware

from eigenfail import __version__
from eigenfail_api import openapi, parameters
from eigenfail_api.access import change_details
from eigenfail_api.access.authentication import RULES, Authenticator, Clock, compile_rules
from eigenfail_api.access.middleware import AuthMiddleware, OriginGuard, Preconditions, redact_logs
from eigenfail_api.access.proxy import PeerRecorder
from eigenfail_api.dashboard import (
    analysis_page,
    campaign_page,
    comparison_page,
    copying,
    episode_page,
    episodes_page,
    failures_page,
    gate_page,
    glossary_page,
    keys_page,
    launch_page,
    measures_page,
    mode_page,
    overview_page,
    release_page,
    rendering,
    replay_page,
    search_page,
    suites_page,
    workers_page,
)
from eigenfail_api.extensions import Extension, load_extensions
from eigenfail_api.middleware import Disconnects, EntityTags, HeadRequests, SecurityHeaders
from eigenfail_api.problems import HANDLERS
from eigenfail_api.routes import (
    analyses,
    campaigns,
    episodes,
    events,
    failures,
    keys,
    operations,
    plugins,
    recordings,
    versions,
)
from eigenfail_api.routes.events import EventFeed
from eigenfail_api.settings import (
    ApiSettings,
    refuse_open_door,
    refuse_unsafe_sign_in,
    refuse_without_keys,
)
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.store import Store

ROUTERS = (
    analyses.figures_router,
    operations.workers_router,
    campaigns.router,
    campaigns.suites_router,
    episodes.router,
    failures.router,
    analyses.router,
    versions.router,
    versions.gates_router,
    recordings.router,
    analyses.triage_router,
    events.router,
    plugins.router,
    operations.router,
    keys.router,
    keys_page.router,
    overview_page.router,
    campaign_page.router,
    measures_page.router,
    analysis_page.router,
    mode_page.router,
    episodes_page.router,
    failures_page.router,
    episode_page.router,
    replay_page.router,
    comparison_page.router,
    release_page.router,
    gate_page.router,
    workers_page.router,
    search_page.router,
    copying.router,
    suites_page.router,
    glossary_page.router,
)
# Its parameters have any name: every setting of every plug-in.
FORMS = (launch_page.router,)


@cache
def _included_routers(extensions: tuple[Extension, ...]) -> tuple[BaseRoute, ...]:
    """Return the routes of an application that has the given extensions.

    FastAPI analyses a route at its first request and keeps the result with the included router. All
    applications of a process share this result.
    """
    including = APIRouter(
        default_response_class=parameters.Json, generate_unique_id_function=lambda route: route.name
    )
    refusers = (
        parameters.refuse_unknown_parameters,
        parameters.refuse_repeated_parameters,
        parameters.refuse_other_media,
    )
    refused = [Depends(refuse) for refuse in refusers]
    for router in FORMS:
        including.include_router(router)
    brought = (router for extension in extensions for router in extension.routers)
    for router in (*ROUTERS, *brought):
        including.include_router(router, dependencies=refused)
    return tuple(including.routes)


def create_app(
    store: Store,
    settings: ApiSettings,
    clock: Clock = now_ms,
    extensions: Sequence[Extension] | None = None,
) -> FastAPI:
    """Return the application for an open store, which the caller closes.

    Args:
        store: where everything is kept.
        settings: settings of the service.
        clock: milliseconds since 1970, for the expiry of keys and sessions.
        extensions: what plug-ins add; None: the extensions that are installed.

    Raises:
        InvalidValue: other machines could reach the service without a key, or clients could name
            any user.
    """
    refuse_open_door(settings)
    refuse_unsafe_sign_in(settings)
    refuse_without_keys(settings, store.keys)
    redact_logs()
    installed = load_extensions((*ROUTERS, *FORMS)) if extensions is None else tuple(extensions)
    app = FastAPI(
        title="eigenfail",
        version=__version__,
        summary="Finds, groups, replays and prices rare failures of driving stacks.",
        # FastAPI's own pages load scripts from another host. The security policy forbids that, and
        # a machine without internet does not have this host.
        docs_url=None,
        redoc_url=None,
        default_response_class=parameters.Json,
        exception_handlers=rendering.wrap_for_browsers(HANDLERS),
        generate_unique_id_function=lambda route: route.name,
    )
    app.state.store = store
    app.state.settings = settings
    app.state.authenticator = Authenticator(store, settings, clock)
    app.state.readiness = operations.Readiness(store)
    app.state.feed = EventFeed(store, settings.poll_s)
    app.state.registry = CollectorRegistry()
    app.state.registry.register(operations.CampaignCollector(store))
    app.router.routes.extend(_included_routers(installed))
    app.mount("/static", rendering.Assets(directory=rendering.STATIC), name="static")
    app.openapi = lambda: openapi.build_document(app)  # type: ignore[method-assign]  # FastAPI's own way
    # The middleware added last sees a request first.
    # Inside of RequestCounter, which would count a client who has gone as an error of the service.
    app.add_middleware(Disconnects)
    app.add_middleware(EntityTags)
    app.add_middleware(HeadRequests)
    # Preconditions is outside of HeadRequests and EntityTags, because these answer its questions
    # about tags. It is inside of AuthMiddleware, so that only permitted requests ask.
    app.add_middleware(Preconditions)
    rules = [*RULES]
    for extension in installed:
        for scope, lines in extension.scopes.items():
            rules += compile_rules(scope, lines)
        change_details.RECORDED.update(extension.recorded)
    app.add_middleware(
        AuthMiddleware, authenticator=app.state.authenticator, store=store, rules=tuple(rules)
    )
    links = rendering.ForeignLinks(
        navigation=tuple(entry for each in installed for entry in each.navigation),
        campaign_files=tuple(file for each in installed for file in each.campaign_files),
    )
    app.add_middleware(rendering.LinkMiddleware, links=links)
    app.add_middleware(OriginGuard, hosts=settings.names)
    app.add_middleware(operations.RequestCounter, registry=app.state.registry)
    # Outside of everything that refuses requests, so that refusals have the headers, too.
    app.add_middleware(SecurityHeaders)
    if settings.proxies:
        app.add_middleware(ProxyHeadersMiddleware, trusted_hosts=[*settings.proxies])
    # ProxyHeadersMiddleware replaces the address that the connection came from.
    app.add_middleware(PeerRecorder)
    # Once more, outermost: refusals are answers, too, and their clients may have gone.
    app.add_middleware(Disconnects)
    return app
