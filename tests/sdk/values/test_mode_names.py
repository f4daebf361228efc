"""Names that are proposed for failure modes: short, complete, and each another one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eigenfail.values.analysis import LONGEST_MODE_NAME, propose_mode_names
from eigenfail_services.analysis.behaviour import describe_motion
from eigenfail_services.analysis.words import Clock, describe

NOISE = (
    "Mode 1: Longitudinal +1.8 sigma (ahead), peak +2.9, in 12 of 14 steps during 3.4 … 2.1 s, "
    "-0.9 sigma (back) during 1.2 … 0.0 s before its medoid's impact, and 2 weaker; lateral +0.7 "
    "sigma (to the left) during 3.4 … 2.1 s before its medoid's impact. Its medoid is episode 1/7."
)
BRAKES = "The ego brakes at up to 5.1 m/s² from 3.4 to 0.0 s before the collision"


@pytest.mark.parametrize(
    ("words", "names"),
    [
        (
            [NOISE],
            ["Longitudinal +1.8 sigma (ahead), peak +2.9, in 12 of 14 steps during 3.4 … 2.1 s"],
        ),
        (["Mode 1: It brakes late. Then it does not."], ["It brakes late"]),
        (["", ""], ["Mode 1", "Mode 2"]),
        (
            [f"Mode 1: {BRAKES}, and accelerates at up to 2.2 m/s² from 9.0 to 4.0 s before that."],
            [BRAKES],
        ),
        (
            [
                "Mode 1: The ego does not brake. Lateral +1.1 sigma during 3.0 … 1.0 s.",
                "Mode 2: The ego does not brake. Longitudinal +1.1 sigma during 3.0 … 1.0 s.",
                "Mode 3: The ego does brake.",
            ],
            [
                "The ego does not brake. Lateral +1.1 sigma during 3.0 … 1.0 s (mode 1)",
                "The ego does not brake. Longitudinal +1.1 sigma during 3.0 … 1.0 s (mode 2)",
                "The ego does brake",
            ],
        ),
        (["Mode 1: " + "far " * 40], ["Mode 1"]),
        (["A.", "A (mode 1).", "A."], ["A (mode 1)", "A (mode 1) (mode 2)", "A (mode 3)"]),
        (["Mode 2.", ""], ["Mode 2 (mode 1)", "Mode 2"]),
        (["It stops.", "It stops (mode 2)."], ["It stops", "It stops (mode 2)"]),
    ],
)
def test_a_name_ends_with_a_phrase(words, names):
    assert propose_mode_names(words) == tuple(names)


def describe_mode(number, seed, channels):
    """What an analysis says of a mode: behaviour and noise."""
    rng = np.random.default_rng(seed)
    times_s = 0.1 * np.arange(-39, 1)
    moved = describe_motion(rng.normal(-1.0, 3.0, (5, 40)), times_s, 0.1, "collision")
    z = rng.normal(size=(40, len(channels))).cumsum(axis=0) / 4.0
    noise = describe(z, Clock(40, 0.1, "its medoid's impact"), channels)
    return (
        f"Mode {number}: {moved * (seed % 2)}{' ' * (seed % 2)}{noise} Its medoid is episode 1/7."
    )


@given(
    st.lists(st.integers(0, 6), min_size=1, max_size=12),
    st.sampled_from([("longitudinal", "lateral"), ("gust",), ("every.longitudinal", "missed")]),
)
def test_names_are_short_complete_and_unique(seeds, channels):
    """Of modes that are described alike, too."""
    words = [describe_mode(n, seed, channels) for n, seed in enumerate(seeds, start=1)]
    names = propose_mode_names(words)
    assert len({*names}) == len(names)
    for number, (name, text) in enumerate(zip(names, words, strict=True), start=1):
        assert 0 < len(name) <= LONGEST_MODE_NAME
        assert name[-1] != "…"
        assert name.count("(") == name.count(")")
        beginning = name.removesuffix(f" (mode {number})")
        rest = text.removeprefix(f"Mode {number}: ")
        assert rest.startswith(beginning)
        assert rest[len(beginning) :].startswith((", ", "; ", ". ", " from ", " during "))


PARTS = ("A", "B", "Mode 1", "Mode 2", " (mode 1)", " (mode 2)", ". ", ", ", "x" * 70)


@given(st.lists(st.lists(st.sampled_from(PARTS), max_size=4).map("".join), max_size=5))
def test_names_of_any_descriptions_are_unique(words):
    names = propose_mode_names(words)
    assert len({*names}) == len(names) == len(words)
    assert all(0 < len(name) <= LONGEST_MODE_NAME for name in names)
