"""A browser and a service with campaigns, as for the pages of the core."""

from borrowed_fixtures import borrow

globals().update(borrow("browser"))
