"""A real service on real sockets, with a worker."""

from borrowed_fixtures import borrow

globals().update(borrow("integration"))
