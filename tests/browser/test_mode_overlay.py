"""The failures of a mode over each other: loaded when opened, played, scrubbed, aligned."""

import json

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser

INKS = """canvas => {
  const {data} = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
  const found = new Set();
  for (let at = 0; at < data.length; at += 4) found.add(data.slice(at, at + 4).join(" "));
  return [...found];
}"""
"""The colours of the picture."""


@pytest.fixture
def opened(visit, made):
    """The page of a mode, with its overlay open: the page, and the overlay."""

    def open_page(**options):
        page = visit(f"/analyses/{made.snapshot}/modes/1", **options)
        page.get_by_text("All failures over each other, in one scene").click()
        found = page.locator(".overlay")
        expect(found.locator("[data-readout]")).to_contain_text("failures have begun")
        return page, found

    return open_page


def read_scene(overlay):
    return json.loads(overlay.locator("[data-player]").get_attribute("data-values"))


def test_it_comes_when_it_is_opened_and_shows_the_collisions_of_all(visit, made, opened):
    asked = []
    page = visit(f"/analyses/{made.snapshot}/modes/1")
    page.on("request", lambda request: asked.append(request.url))
    expect(page.locator(".overlay")).to_have_count(0)
    page.get_by_text("All failures over each other, in one scene").click()
    readout = page.locator(".overlay [data-readout]")
    scene = read_scene(page.locator(".overlay"))
    count = len(scene["failures"])
    assert count > 1
    expect(readout).to_contain_text(
        f"t = 0.0 s · {count} of {count} failures have begun, {count} have ended"
    )
    assert [url for url in asked if url.endswith("/overlay")]


def test_the_animation_of_a_mode_plays_on_the_page_of_the_analysis(visit, made, tiny_formats):
    asked = []
    page = visit(f"/analyses/{made.snapshot}")
    page.on("request", lambda request: asked.append(request.url))
    page.get_by_text("Watch all its failures over each other (GIF)").first.click()
    animation = page.locator("img.animation").first
    expect(animation).to_be_visible()
    page.wait_for_function("image => image.naturalWidth > 0", arg=animation.element_handle())
    # Those of the other modes are made when they are looked at.
    assert len([url for url in asked if url.endswith("/animation")]) == 1


def test_it_is_played_scrubbed_and_obeys_keys(opened):
    _, overlay = opened()
    scrub, readout = overlay.locator("[data-scrub]"), overlay.locator("[data-readout]")
    scrub.focus()
    scrub.press("ArrowLeft")
    expect(readout).to_contain_text("t = −0.1 s")
    scrub.press("Shift+ArrowLeft")
    expect(readout).to_contain_text("t = −1.1 s")
    expect(scrub).to_have_attribute("aria-valuetext", "−1.1 s")
    scrub.press("Home")
    # Only the longest failures have begun there.
    scene = read_scene(overlay)
    longest = [each for each in scene["failures"] if each["last"] == scene["last"]]
    expect(readout).to_contain_text(f"{len(longest)} of {len(scene['failures'])} failures")
    overlay.locator("[data-speed]").select_option("4")
    overlay.locator("[data-play]").click()
    expect(readout).to_contain_text("t = 0.0 s")
    expect(overlay.locator("[data-play]")).to_have_text("Play")


def test_it_may_be_aligned_at_the_start(opened):
    _, overlay = opened()
    scene, readout = read_scene(overlay), overlay.locator("[data-readout]")
    count, last = len(scene["failures"]), scene["last"]
    overlay.get_by_label("Aligned at").select_option("start")
    expect(readout).to_contain_text(f"t = {last * scene['dt']:.1f} s")
    overlay.locator("[data-scrub]").focus()
    overlay.locator("[data-scrub]").press("Home")
    expect(readout).to_contain_text(f"t = 0.0 s · {count} of {count} failures have begun, 0 have")
    # All begin at the same place: their egos lie on one another.
    firsts = {tuple(each["tracks"][0][1:3]) for each in scene["failures"]}
    assert len(firsts) == 1


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_medoid_is_opaque_and_the_others_are_translucent(opened, scheme):
    page, overlay = opened(color_scheme=scheme)
    expected = page.evaluate(
        "async () => { const {palette} = await import('/static/js/palette.js');"
        " return palette().ego.match(/\\d+/g).join(' '); }"
    )
    canvas, scrub = overlay.locator("canvas"), overlay.locator("[data-scrub]")
    scrub.fill(str(int(scrub.get_attribute("max")) - 30))
    inks = canvas.evaluate(INKS)
    assert f"{expected} 255" in inks
    # Shades of the same hue between the road and the medoid.
    assert len(inks) > 50


DRAWN_WITH_OTHERS = """async (values) => {
  const {overlay} = await import('/static/js/overlay.js');
  const scene = {...JSON.parse(values), align: 'end'};
  for (const failure of scene.failures) {
    const beside = failure.tracks[0].map((value, at) => value + (at % 3 === 1 ? 3.5 : 0));
    failure.tracks.push(beside);
    failure.sizes.push([5, 2]);
  }
  const canvas = document.querySelector('.overlay canvas');
  return [false, true].map((hasOthers) => {
    overlay.draw(canvas, {...scene, hasOthers}, scene.last);
    return canvas.toDataURL();
  });
}"""


def test_other_vehicles_are_drawn_on_request(opened):
    """The scenes of the test bench have two vehicles: a third one is made up in the page."""
    page, overlay = opened()
    values = overlay.locator("[data-player]").get_attribute("data-values")
    own = overlay.locator("canvas").evaluate("canvas => canvas.toDataURL()")
    struck_only, all_of_them = page.evaluate(DRAWN_WITH_OTHERS, values)
    assert struck_only == own
    assert all_of_them != own
    # The scenes of the page have no vehicle but the one that is struck.
    overlay.get_by_label("Other vehicles").check()
    assert overlay.locator("canvas").evaluate("canvas => canvas.toDataURL()") == own
