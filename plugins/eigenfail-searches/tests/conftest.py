"""Fixtures of the core's tests of methods."""

from borrowed_fixtures import borrow

episode = borrow("services/methods")["episode"]
