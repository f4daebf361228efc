"""Pages, asked for as a browser asks."""

from borrowed_fixtures import borrow

globals().update(borrow("api/dashboard"))
