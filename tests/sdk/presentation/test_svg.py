"""Diagrams as SVG files: seen by everybody, described in words, and the same every time."""

import pytest
from contrast import contrast

from eigenfail.presentation.svg import INK, MARKS, MUTED, Drawing, draw_svg


def test_everything_stands_out_from_the_page():
    for colour in (INK, MUTED, *(mark.colour for mark in MARKS)):
        assert contrast(colour, "#ffffff") >= 4.5


@pytest.mark.parametrize("trait", ["line", "marker", "hatch"])
def test_marks_differ_without_their_colours(trait):
    assert len({getattr(mark, trait) for mark in MARKS}) == len(MARKS)


def drawn(name="a-picture"):
    return draw_svg(
        name, "A < B", 'Say "so"', Drawing(lambda figure: figure.subplots().plot([1, 2]))
    )


def test_a_picture_is_the_same_every_time_and_tells_what_it_shows():
    svg = drawn()
    assert svg == drawn()
    assert svg.startswith("<svg ")
    assert '<title id="a-picture-title">A &lt; B</title>' in svg
    assert '<desc id="a-picture-desc">Say &quot;so&quot;</desc>' in svg
    assert "<metadata" not in svg
    assert 'xmlns="http://www.w3.org/2000/svg"' in svg


def test_names_inside_pictures_do_not_meet():
    def names(svg):
        return {part.split('"')[0] for part in svg.split(' id="')[1:]}

    assert names(drawn("one"))
    assert names(drawn("one")).isdisjoint(names(drawn("two")))
