"""A client whose service is in this process, as for the core's client."""

from borrowed_fixtures import borrow

globals().update(borrow("sdk/client"))
