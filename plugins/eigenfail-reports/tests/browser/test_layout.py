"""The report at four widths in both colour schemes, held to what every page is held to."""

import deadlines
import pytest
from borrowed_fixtures import borrow

from eigenfail_reports.report import make

pytestmark = [pytest.mark.browser, pytest.mark.timeout(deadlines.TEST_S)]

LAYOUT = borrow("browser", "test_layout.py")
tab, troubles_of = LAYOUT["tab"], LAYOUT["troubles_of"]


def test_a_report_fits_every_width_and_axe_finds_nothing(tab, store, filled, tmp_path):
    file = tmp_path / "report.html"
    file.write_bytes(make(store, (filled.long, filled.ast), 0).html())
    tab.goto(file.as_uri())
    assert not troubles_of(tab)
