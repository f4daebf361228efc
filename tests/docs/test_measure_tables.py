"""The tables of measures and of columns in docs say what the declarations say."""

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parent))

import measure_tables


@pytest.mark.parametrize("name", measure_tables.PAGES)
def test_table_in_docs_is_up_to_date(name, root):
    page = (root / "docs" / name).read_text()
    assert page == measure_tables.render_page(name), "Run `make docs`."
