"""A report in a real browser, opened as a file: quiet, asking for nothing, narrow or on paper."""

import pytest
from playwright.sync_api import expect

from eigenfail_reports.report import make

pytestmark = pytest.mark.browser

OVERFLOW = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
A4_WIDTH = 673  # 210 mm without two margins of 16 mm, at 96 pixels an inch
NOW_MS = 1_760_000_000_000


@pytest.fixture(scope="module")
def file(store, made, tmp_path_factory):
    """The page of a report on campaigns in every state, one of them analysed."""
    path = tmp_path_factory.mktemp("report") / "report.html"
    campaigns = (made.ast, made.baseline, made.difs, made.queued)
    path.write_bytes(make(store, campaigns, NOW_MS).html())
    return path


@pytest.fixture
def opened(browser, file):
    """Opens it; a request beside the file's own, or a word on the console, fails the test."""
    pages, troubles = [], []

    def go(width, **options):
        page = browser.new_page(viewport={"width": width, "height": 900}, **options)
        pages.append(page)
        page.on("request", lambda request: troubles.append(request.url))
        page.on("console", lambda message: troubles.append(message.text))
        page.on("pageerror", lambda error: troubles.append(str(error)))
        page.goto(file.as_uri())
        return page

    yield go
    for page in pages:
        page.close()
    assert troubles == [file.as_uri()] * len(pages)


@pytest.mark.parametrize("width", [1200, 375])
def test_it_is_drawn_and_scrolls_down_only(opened, width):
    page = opened(width)
    expect(page.locator("h1")).to_be_visible()
    for picture in page.locator("figure svg").all():
        box = picture.bounding_box()
        assert box["width"] >= 300
        assert box["height"] >= 100
    for summary in page.locator("summary").all():
        summary.click()
    assert page.evaluate(OVERFLOW) <= 0
    assert page.locator("section").count() >= 12


def test_it_needs_no_script(opened):
    page = opened(1200, java_script_enabled=False)
    page.get_by_role("link", name="Provenance").click()
    expect(page.locator("#provenance")).to_be_in_viewport()
    page.locator("#setup summary").click()
    expect(page.locator("#setup details table")).to_be_visible()


def test_on_paper_nothing_is_cut_off(opened):
    page = opened(A4_WIDTH)
    page.emulate_media(media="print")
    assert page.evaluate(OVERFLOW) <= 0
    expect(page.locator("nav")).to_be_hidden()
    expect(page.locator("#setup details.folded table")).to_be_visible()


def test_a_picture_is_read_by_its_words(opened):
    page = opened(1200)
    picture = page.get_by_role("img", name="Likelihood and severity of failures")
    expect(picture).to_be_visible()


def test_it_is_downloaded_from_the_page_of_its_campaign(visit, made):
    page = visit(f"/campaigns/{made.replay}")
    with page.expect_download() as download:
        page.get_by_role("link", name="Report").click()
    assert download.value.suggested_filename == "report.html"
    assert "<h1" in download.value.path().read_text()
