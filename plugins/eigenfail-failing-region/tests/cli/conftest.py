"""Commands run as those of the core: against the real API, without a socket."""

from borrowed_fixtures import borrow

globals().update(borrow("sdk/cli"))
