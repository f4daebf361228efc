"""The failing region as a terminal and a page word it, from values that are known."""

from eigenfail.values.estimates import Interval, Rate
from eigenfail_failing_region.presentation import describe_region
from eigenfail_failing_region.values import Box, Region

SAMPLED = Rate(0.25, 25, 100, Interval(0.175, 0.343))


def texts(table):
    return [tuple(cell.line for cell in row) for row in table.cells]


def region(**fields):
    return Region(
        campaigns=(2, 5),
        scenario="cut_in",
        parameters=("distance_m",),
        episodes=2000,
        failures=150,
        **fields,
    )


def test_a_region_that_was_not_found_says_why():
    found = region(problem="Too few failures. Run more.", warnings=("Campaign 5 is running.",))
    assert describe_region(found) == (
        "Failing region of cut_in, campaigns 2, 5: 150 of 2,000 episodes failed; distance_m varied",
        "Too few failures. Run more.",
        "Warning: Campaign 5 is running.",
    )


def test_boxes_of_a_region_are_summed_up_in_a_last_row():
    near = Box(bounds=(), words="distance up to 56 m", coverage=SAMPLED, precision=SAMPLED)
    empty = Box(bounds=(), words="speed over 24 m/s", coverage=SAMPLED, precision=None)
    found = region(
        boxes=(near, empty), failure_rate=SAMPLED, coverage=SAMPLED, precision=SAMPLED, p_value=1e-5
    )
    _, table, chance = describe_region(found)
    share = "25.0 % [17.5, 34.3]"
    assert texts(table) == [
        ("distance up to 56 m", share, share, "25", "100"),
        ("speed over 24 m/s", share, "–", "–", "–"),
        ("all of these", share, share, "25", "100"),
    ]
    assert chance == (
        "Found on half of the episodes, counted on the others: 25.0 % [17.5, 34.3] of these fail. "
        "By chance alone: p = 1.00×10⁻⁵."
    )
    assert len(texts(describe_region(region(boxes=(near,)))[1])) == 1
