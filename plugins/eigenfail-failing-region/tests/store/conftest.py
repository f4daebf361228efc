"""Stores of every kind, each test's own and empty."""

from borrowed_fixtures import borrow

globals().update(borrow("services/store"))
