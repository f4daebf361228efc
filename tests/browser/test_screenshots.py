"""The script that makes the documents' pictures of the dashboard."""

import sys
from pathlib import Path

import deadlines
import pytest
from PIL import Image

pytestmark = pytest.mark.browser

ROOT = Path(__file__).parents[2]
NAMES = {"overview", "campaign", "launch", "episode", "analysis", "compare"}
MOST_BYTES = 150_000


@pytest.fixture
def screenshots(monkeypatch):
    monkeypatch.setattr(sys, "path", [*sys.path, str(ROOT / "benchmarks")])
    import screenshots

    return screenshots


def test_every_page_has_a_small_picture(screenshots, address, made, tmp_path):
    # Playwright runs one loop for a process: the script's own comes in a process of its own.
    import subprocess

    script = ROOT / "benchmarks" / "screenshots.py"
    done = subprocess.run(
        [sys.executable, script, "--url", address, "--folder", tmp_path],
        capture_output=True,
        text=True,
        check=False,
        timeout=deadlines.PROCESS_S,
    )
    assert done.returncode == 0, done.stderr
    files = {file.stem: file for file in tmp_path.glob("*.png")}
    assert files.keys() == NAMES
    for file in files.values():
        picture = Image.open(file)
        assert picture.width == screenshots.WIDTH
        assert 300 < picture.height <= screenshots.TALLEST
        assert len(picture.convert("RGB").getcolors(100_000)) > 5
        assert file.stat().st_size < MOST_BYTES


def test_it_shows_the_campaign_with_the_most_failures(screenshots, address, made):
    with screenshots.Client(address) as client:
        shown = screenshots.subject(client)
    assert shown.campaign == made.ast
    assert shown.analysis == made.analysis
    assert shown.other == made.baseline
    assert shown.episode in made.failures
