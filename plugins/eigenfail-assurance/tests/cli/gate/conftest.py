"""Gates as those of the core: against a baseline that is made once."""

from borrowed_fixtures import borrow

globals().update(borrow("sdk/cli/gate"))
