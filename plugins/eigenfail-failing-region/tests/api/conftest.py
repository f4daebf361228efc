"""The API with the extension, asked without a socket."""

import pytest
from borrowed_fixtures import borrow

from eigenfail_api.app import create_app
from eigenfail_api.settings import ApiSettings
from eigenfail_failing_region.routes import extension

globals().update(borrow("api"))


@pytest.fixture
def app(store):
    """The service with this extension alone, as it is installed."""
    return create_app(store, ApiSettings(poll_s=0.02), extensions=(extension,))
