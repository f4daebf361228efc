"""docs/analysis.md tells of every setting and every result of an analysis."""

import re

import pytest

from eigenfail.values.analysis import AnalysisResult, AnalysisSettings, FailureMode

# Rows and their labels, which say what they are.
PLAIN = {"episodes", "labels", "campaigns", "notes", "failures", "centre", "medoid_campaign"}


@pytest.fixture(scope="module")
def page(root):
    return (root / "docs/analysis.md").read_text()


def test_every_setting_has_its_row_with_the_default(page):
    section = page.split("## Settings")[1].split("\n## ")[0]
    rows = dict(re.findall(r"^\| `(\w+)` \| ([^|]+) \|", section, re.MULTILINE))
    defaults = {name: getattr(AnalysisSettings(), name) for name in rows if name in fields()}
    assert sorted(defaults) == sorted(fields())
    said = {name: rows[name].strip("` ") for name in defaults}
    words = {"clusters": "by silhouette", "campaigns": "none"}
    assert said == {name: words.get(name, str(value)) for name, value in defaults.items()}


def fields():
    return AnalysisSettings.__struct_fields__


def test_every_number_is_explained(page):
    names = {*AnalysisResult.__struct_fields__, *FailureMode.__struct_fields__} - PLAIN
    assert [name for name in sorted(names) if f"`{name}`" not in page] == []
