"""The page of a region at four widths in both colour schemes, held to what every page is."""

import deadlines
import pytest
from borrowed_fixtures import borrow

pytestmark = [pytest.mark.browser, pytest.mark.timeout(deadlines.TEST_S)]

LAYOUT = borrow("browser", "test_layout.py")
tab, show, troubles_of = (LAYOUT[name] for name in ("tab", "show", "troubles_of"))


@pytest.mark.parametrize("page", ["region", "region/boxes"])
def test_the_page_fits_every_width_and_axe_finds_nothing(show, filled, page):
    assert not troubles_of(show(f"/campaigns/{filled.varied}/{page}"))
