"""An API that asks for keys, its holders, and a clock that is set by hand."""

import pytest
from starlette.testclient import TestClient

from eigenfail.values.access import KeyRequest, Scope
from eigenfail_api.app import create_app
from eigenfail_api.settings import ApiSettings
from eigenfail_services.access import make_key
from eigenfail_services.store.clock import now_ms

ADDRESS = "http://127.0.0.1:8440"


class Clock:
    """Milliseconds since 1970, as many as a test says."""

    def __init__(self):
        self.at_ms = now_ms()

    def __call__(self):
        return self.at_ms

    def pass_s(self, seconds):
        self.at_ms += round(1_000 * seconds)


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def app(store, clock):
    return create_app(store, ApiSettings(poll_s=0.02), clock, extensions=())


@pytest.fixture
def keys(store):
    """A key of each scope."""
    return {
        scope.value: make_key(store, KeyRequest(f"the {scope}", scope))
        for scope in (Scope.ADMIN, Scope.RUNNER, Scope.VIEWER)
    }


@pytest.fixture
def browser(app):
    """A browser that follows nobody."""
    accept = {"Accept": "text/html"}
    with TestClient(app, base_url=ADDRESS, headers=accept, follow_redirects=False) as client:
        yield client


@pytest.fixture
def show():
    """The header that shows a token."""
    return lambda token: {"Authorization": f"Bearer {token}"}


@pytest.fixture
def as_holder(http, keys, show):
    """Asks the API with the key of a scope."""

    def ask(scope, method, path, **request):
        return http.request(method, path, headers=show(keys[scope].token), **request)

    return ask


@pytest.fixture
def changes(store):
    """The lines of the audit log, oldest first."""
    return lambda: store.audit.page(1_000).items[::-1]
