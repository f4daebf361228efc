"""Services that are killed, on one database."""

import sys

from borrowed_fixtures import TESTS, borrow

sys.path.append(str(TESTS / "chaos"))
globals().update(borrow("chaos"))
