"""The script that makes the documents' pictures of the dashboard."""

import subprocess
import sys
from pathlib import Path

import deadlines
import pytest
from benchmarks.pictures import screenshots
from PIL import Image

pytestmark = pytest.mark.browser

ROOT = Path(__file__).parents[2]
NAMES = {"overview", "campaign", "launch", "episode", "analysis", "compare"}
MOST_BYTES = 150_000


def test_every_page_has_a_small_picture(address, made, tmp_path):
    # Playwright runs one loop for a process: the script's own comes in a process of its own.
    script = [sys.executable, "-m", "benchmarks.pictures.screenshots"]
    done = subprocess.run(
        [*script, "--url", address, "--folder", tmp_path],
        cwd=ROOT,
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


def test_it_shows_the_campaign_with_the_most_failures(address, made):
    with screenshots.Client(address) as client:
        shown = screenshots.subject(client)
    assert shown.campaign == made.ast
    assert shown.analysis == made.analysis
    assert shown.other == made.baseline
    assert shown.episode in made.failures
