"""Pieces of reports, by hand-worked cases."""

import numpy as np
import pytest
from contrast import contrast
from msgspec.structs import replace

from eigenfail.presentation.svg import Drawing, draw_svg
from eigenfail.values.estimates import Estimate, Interval
from eigenfail_reports.material import (
    pick_evenly,
    sample_note,
    split_into_groups,
    spread,
    stack_noise,
)
from eigenfail_reports.page import inline_svg, list_probability, make_environment


def test_text_stands_out_from_what_it_lies_on():
    source, _, _ = make_environment().loader.get_source(make_environment(), "report.css")
    css = dict(
        line.strip(" ;").removeprefix("--").split(": ")
        for line in source.splitlines()
        if line.strip().startswith("--")
    )
    for text in ("ink", "muted", "accent"):
        for ground in ("#ffffff", css["sunken"]):
            assert contrast(css[text], ground) >= 4.5
    assert contrast(css["ink"], css["note"]) >= 4.5


def test_a_picture_in_the_page_names_no_address():
    svg = draw_svg("one", "One", "A line", Drawing(lambda figure: figure.subplots().plot([1, 2])))
    assert 'xmlns="http://www.w3.org/2000/svg"' in svg
    assert "http" not in inline_svg(svg)


def test_noise_stands_side_by_side_at_the_start_or_at_the_median_collision():
    short, long = np.array([[1.0, 0.0], [2.0, 0.0]]), np.full((4, 2), 9.0)
    noise = [short, short, long]
    start = stack_noise(noise, (5, 2), at_collision=False)
    assert start[0, :, 0].tolist()[:2] == [1.0, 2.0]
    assert np.isnan(start[0, 2:]).all()
    end = stack_noise(noise, (5, 2), at_collision=True)
    assert end[0, :2, 0].tolist() == [1.0, 2.0]
    assert end[2, :2, 0].tolist() == [9.0, 9.0]
    assert np.isnan(end[2, 2:]).all()


def test_mean_and_deviation_count_only_those_that_are_there():
    rows = np.array([[[1.0, 0.0], [4.0, 0.0]], [[3.0, 0.0], [np.nan, np.nan]]])
    reached, mean, deviation = spread(rows)
    assert reached.tolist() == [2, 1]
    assert mean[:, 0].tolist() == [2.0, 4.0]
    assert deviation[0, 0] == pytest.approx(2.0**0.5)
    assert np.isnan(deviation[1, 0])


def test_samples_are_even_and_say_so():
    assert pick_evenly(range(10), 5) == [0, 2, 4, 6, 8]
    assert pick_evenly(range(3), 5) == [0, 1, 2]
    assert pick_evenly([], 5) == []
    assert [list(group) for group in split_into_groups([1, 2, 3], 2)] == [[1, 2], [3]]
    assert sample_note(5, 5, "failures") == ""
    assert sample_note(2000, 12345, "failures").startswith("A sample of 2,000 of 12,345 failures")


def test_a_probability_has_its_interval_or_its_lower_bound_in_columns_of_their_own():
    told = Estimate(
        by="subset simulation",
        episodes=600,
        probability=1.2e-5,
        cv=0.3,
        interval=Interval(5e-6, 3e-5),
    )
    assert list_probability(told) == (1.2e-5, 5e-6, 3e-5, None)
    bound = replace(told, by="importance sampling", bound="lower", interval=None)
    assert list_probability(bound) == (None, None, None, 1.2e-5)
