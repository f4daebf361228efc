"""The API with the extension, which asks for keys."""

import pytest
from borrowed_fixtures import borrow

from eigenfail_api.app import create_app
from eigenfail_api.settings import ApiSettings
from eigenfail_failing_region.routes import extension

globals().update(borrow("api/access"))


@pytest.fixture
def app(store, clock):
    return create_app(store, ApiSettings(poll_s=0.02), clock, extensions=(extension,))
