"""Pictures of the dashboard's pages, from a service that runs: docs/pictures/screens.

    python -m benchmarks.pictures.screenshots --url http://127.0.0.1:8440

They show the campaign with the most failures, beside the first one of another method. Each file has
the words of its page in a text chunk, so that a test can compare its figures with a document's.
"""

import argparse
import io
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from PIL import Image
from PIL.PngImagePlugin import PngInfo
from playwright.sync_api import Page, ViewportSize, expect, sync_playwright

from eigenfail.client import Client
from eigenfail.values.summary import Summary

CHROMIUM = shutil.which("chromium-headless-shell") or "/usr/bin/chromium"
ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"]
FOLDER = Path(__file__).parents[2] / "docs" / "pictures" / "screens"
WIDTH, HEIGHT, TALLEST = 1280, 800, 1600
COLOURS = 64
PATIENCE_MS = 20_000
WORDS = "words"
"""Name of the text chunk."""
MOST_WORDS = 4_000
"""Characters of it: what is in the picture, which ends at TALLEST."""


class Subject(NamedTuple):
    """What there is to show."""

    campaign: int
    other: int | None
    episode: int | None
    analysis: int | None


def subject(client: Client) -> Subject:
    """The campaign with the most failures, its worst, its newest analysis; another method's.

    Raises:
        ValueError: there is no campaign at all.
    """
    summaries: list[Summary] = list(client.campaigns.summaries())
    best = max(summaries, key=lambda each: (each.counts.failures, -each.campaign))
    others = (each.campaign for each in reversed(summaries) if each.method != best.method)
    worst = client.episodes.list(best.campaign, outcome="collision", sort="-severity")
    analyses = client.analyses.list(best.campaign)
    done = [each.id for each in analyses if each.state == "done"]
    return Subject(
        best.campaign,
        next(others, None),
        next((row.index for row in worst), None),
        next(iter(done), None),
    )


def addresses(shown: Subject) -> Iterator[tuple[str, str]]:
    """The name of each picture, and the page that it is of."""
    campaign = f"/campaigns/{shown.campaign}"
    yield "overview", "/"
    yield "campaign", campaign
    yield "launch", "/launch"
    if shown.episode is not None:
        yield "episode", f"{campaign}/episodes/{shown.episode}"
    if shown.analysis is not None:
        yield "analysis", f"/analyses/{shown.analysis}"
    if shown.other is not None:
        yield "compare", f"/comparison?a={shown.other}&b={shown.campaign}"


def take(url: str, folder: Path = FOLDER) -> list[Path]:
    """Save a picture of each page of the service at an address; the files."""
    with Client(url) as client:
        wanted = [*addresses(subject(client))]
    folder.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        size = ViewportSize(width=WIDTH, height=HEIGHT)
        page = browser.new_page(viewport=size, color_scheme="light", reduced_motion="reduce")
        page.set_default_timeout(PATIENCE_MS)
        files = [picture(page, url + path, folder / f"{name}.png") for name, path in wanted]
        browser.close()
    return files


def picture(page: Page, url: str, file: Path) -> Path:
    """Save a page from its top, once its charts are drawn, in few colours."""
    page.goto(url)
    expect(page.locator("html.js")).to_be_attached()
    for plot in page.locator(".plot").all():
        plot.scroll_into_view_if_needed()
        expect(plot.locator("canvas").first).to_be_visible()
    page.evaluate("window.scrollTo(0, 0)")
    whole = Image.open(io.BytesIO(page.screenshot(full_page=True)))
    shot = whole.crop((0, 0, WIDTH, min(whole.height, TALLEST)))
    words = PngInfo()
    words.add_itxt(
        WORDS, " ".join(page.locator("main").inner_text().split())[:MOST_WORDS], zip=True
    )
    few = shot.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
    few.save(file, optimize=True, pnginfo=words)
    return file


def main() -> None:
    """Take the pictures, and say which."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--url", default="http://127.0.0.1:8440", help="of the service")
    parser.add_argument("--folder", type=Path, default=FOLDER, help="for the pictures")
    arguments = parser.parse_args()
    print("\n".join(map(str, take(arguments.url, arguments.folder))))


if __name__ == "__main__":
    main()
