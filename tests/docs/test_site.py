"""The navigation of the site and the index of docs/ name every page once, in one order."""

import re

import pytest
import yaml


@pytest.fixture(scope="module")
def settings(root):
    return yaml.safe_load((root / "mkdocs.yml").read_text())


def list_pages(nav):
    for entry in nav:
        for title, target in entry.items():
            if isinstance(target, list):
                yield from list_pages(target)
            else:
                yield title, target


def test_navigation_and_index_name_every_page_once_in_one_order(settings, root):
    (overview, *pages) = list_pages(settings["nav"])
    assert overview[1] == "README.md"
    index = re.findall(
        r"^\| \[([^\]]+)\]\((\w+\.md)\) \|", (root / "docs/README.md").read_text(), re.MULTILINE
    )
    assert index == pages
    files = sorted(path.name for path in (root / "docs").glob("*.md") if path.name != "README.md")
    assert sorted(name for _, name in pages) == files


def test_index_and_navigation_have_the_same_sections(settings, root):
    sections = [title for entry in settings["nav"] for title in entry]
    headings = re.findall(r"^## (.+)$", (root / "docs/README.md").read_text(), re.MULTILINE)
    assert headings[: len(sections)] == sections
