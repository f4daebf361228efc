"""The pictures in docs/pictures show scenarios and campaigns as they are now."""

import re
from xml.etree import ElementTree as ET

import pytest
from benchmarks.pictures.crash_drawing import crash_view
from benchmarks.pictures.top_view import MOMENTS, SEEN_STEPS, TopView
from core_worlds import list_core_names
from PIL import Image

from eigenfail import plugins


def drawn(svg, kind, css=None):
    """The elements of a kind in a picture."""
    found = ET.fromstring(svg).iter(f"{{http://www.w3.org/2000/svg}}{kind}")
    return [one for one in found if css is None or one.get("class") == css]


def words(svg):
    return [one.text for one in drawn(svg, "text")]


@pytest.mark.parametrize("scenario", list_core_names(plugins.SCENARIOS))
def test_each_scenario_is_drawn_as_it_runs(root, scenario):
    kept = (root / "docs" / "pictures" / f"{scenario}.svg").read_text()
    assert words(kept) == words(TopView(scenario).picture()), "run benchmarks/pictures/drawings.py"
    assert len(drawn(kept, "rect", "truck")) == MOMENTS + 1
    assert len(drawn(kept, "rect", "car")) > MOMENTS
    assert len(drawn(kept, "circle")) == MOMENTS * SEEN_STEPS + 1


def test_the_crash_is_drawn_as_it_happens(root):
    kept, now = (root / "docs" / "pictures" / "crash.svg").read_text(), crash_view()
    assert words(kept) == words(now), "run benchmarks/pictures/drawings.py"
    for kind in ("polyline", "circle", "rect"):
        assert len(drawn(kept, kind)) == len(drawn(now, kind)), (
            "run benchmarks/pictures/drawings.py"
        )
    assert len(drawn(kept, "polyline", "believed")) > 2


def test_pictures_bring_their_own_ground_for_light_and_dark_pages(root):
    for path in (root / "docs" / "pictures").glob("*.svg"):
        svg = path.read_text()
        assert drawn(svg, "rect", "page"), path.name
        assert "@media (prefers-color-scheme: dark)" in drawn(svg, "style")[0].text, path.name


def read_words(file):
    """Return the words of the page that the screenshots' program took a picture of."""
    with Image.open(file) as picture:
        return picture.info["words"]


def test_pictures_of_the_readme_show_the_figures_of_its_text(root):
    readme = (root / "README.md").read_text("utf-8")
    names = re.findall(r"docs/pictures/screens/(\w+)\.png", readme)
    assert names == ["campaign", "analysis"]
    campaign, analysis = (
        read_words(root / "docs" / "pictures" / "screens" / f"{name}.png") for name in names
    )
    of_ast = r"^ 2 ast +(\d+) +(\d+) +(\S+ %) of its search +(\S+) +(\S+)"
    (row,) = re.findall(of_ast, readme, re.MULTILINE)
    episodes, failures, share, log_p, severity = row
    assert f"Failures {failures} of {episodes} {share} of its search" in campaign
    assert f"log p per step [nats] {log_p} of {failures} failures" in campaign
    assert f"Mean severity [m²/s²] {severity}" in campaign
    (verdict,) = re.findall(r"^.* distinct mode.*\.$", readme, re.MULTILINE)
    assert verdict.split(" The largest")[0] in analysis
    (analysed,) = re.findall(r"^(\d+) failures; \d+ components explain", readme, re.MULTILINE)
    assert f"Failures analysed {analysed} of {episodes}" in analysis.replace(" ?", "")
