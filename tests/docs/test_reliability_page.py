"""docs/reliability.md names tests and modules that are there."""

import re

import pytest


@pytest.fixture(scope="module")
def page(root):
    return (root / "docs" / "reliability.md").read_text()


def test_every_test_that_it_names_is_there(page, root):
    named = set(re.findall(r"`(tests/[\w/]+\.py)(?:::(\w+))?`", page))
    assert len(named) > 40
    for path, test in named:
        text = (root / path).read_text()
        assert not test or re.search(rf"^(async )?def {test}\b", text, re.MULTILINE), (path, test)


def test_every_file_that_it_names_is_there(page, root):
    named = set(re.findall(r"`((?:sdk|services|workers|api)/[\w/]+\.py)`", page))
    assert named
    assert [path for path in named if not (root / path).is_file()] == []
