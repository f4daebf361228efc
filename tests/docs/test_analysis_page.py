"""docs/analysis.md tells of every setting and every number of an analysis."""

import re

import pytest

from eigenfail.values.analysis import (
    FEWEST_OF_MODE,
    STABLE,
    AnalysisResult,
    AnalysisSettings,
    FailureMode,
)
from eigenfail_services.analysis import alignment, behaviour, clusters, components
from eigenfail_services.methods.subset import MIN_EFFECTIVE_FIRST_DRAWS
from eigenfail_services.statistics.importance import FEWEST_EFFECTIVE

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


def test_the_numbers_on_the_page_are_those_of_the_code(page):
    for number, words in (
        (components.SMALL_ENTRIES, "{:,} entries"),
        (components.WIDEST, "more than {} columns"),
        (clusters.CLUSTERED_ROWS, "Of more than {} failures"),
        (clusters.ROWS, "silhouettes and bootstrap take {} drawn"),
        (clusters.SILHOUETTE_ROWS, "silhouettes and bootstrap take {} drawn"),
        (clusters.NOISE_DRAWS, "largest of {} draws"),
        (alignment.MIN_STEPS_APART, "at least {} steps apart"),
        (behaviour.WINDOW_S, "that of the last {} s before the collision"),
        (behaviour.STRUCK_MPS2, "differs by {:.0f} m/s² in root mean square"),
        (behaviour.FEWEST_STRUCK, "fewer than `{}` failures struck"),
        (100 * behaviour.LEAST_STRUCK, "fewer than `{:.0f} %` of them"),
        (10.0**-behaviour.DECIMALS, "rounded to {} m/s²"),
        (behaviour.SMOOTHING_S, "Moving means over about {} s"),
        (behaviour.COMPONENTS, "first {} principal components are clustered"),
        (behaviour.RESOLUTION_MPS2, "a difference of {} m/s² in root mean square"),
        (behaviour.ENERGY_S, "over windows of {} s for each channel"),
        (behaviour.MOST_MEMBERS, "that of up to {} failures"),
        (behaviour.SLIGHT_MPS2, "below {:.0f} m/s² the ego"),
        (STABLE, "Rand index is {} or more"),
        (STABLE, "index that begins below `{}`"),
        (FEWEST_OF_MODE, "modes of fewer than `{}` failures"),
        (MIN_EFFECTIVE_FIRST_DRAWS, "fewer than {:.0f} first draws"),
        (FEWEST_EFFECTIVE, "less than {:.0f} independent ones"),
    ):
        assert words.format(number) in " ".join(page.split())
