"""Words for noise never contradict its numbers."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.episode import EpisodeResult, Outcome
from eigenfail.values.proof import ExplainedEpisode, ExplainedStep
from eigenfail.values.shapes import Markov, Once, PerChannel
from eigenfail_services.analysis.words import (
    FAINT,
    JOINED,
    MOST_NEEDED,
    MOST_PUSHES,
    TELLING,
    Clock,
    describe,
    describe_account,
    describe_needed,
    find_pushes,
)

STEPS = 40
TOLD = re.compile(
    r"(?P<mean>[+-]\d+\.\d) sigma \((?P<way>[a-z ]+)\)(?:, peak (?P<peak>\S+\d),)?"
    r"(?: in (?P<some>\d+) of (?P<length>\d+) steps)?"
    r" during (?P<since>\d+) … (?P<until>\d+) steps"
)
IN_STEPS = Clock(STEPS, None)
noises = arrays(np.float32, (STEPS, 2), elements=st.floats(-4.0, 4.0, width=32))
sparse = st.builds(
    lambda z, kept: np.where(kept, z, np.float32(0.0)),
    noises,
    arrays(np.bool_, (STEPS, 2), elements=st.booleans()),
)


def hand_made():
    """+2 sigma longitudinally during 3.2 … 1.1 s before an impact after 4 s."""
    z = np.zeros((STEPS, 2), np.float32)
    z[8:29, 0] = 2.0
    z[20, 0] = 2.9
    return z


@pytest.mark.parametrize("count", [1, 3, 5])
def test_other_channels_have_their_names_and_no_direction(count):
    z = np.zeros((STEPS, count), np.float32)
    z[8:29, -1] = -2.0
    channels = ("gust", "drift", "bias", "glare", "delay")[:count]
    for words, most in ((describe_needed, 4), (describe, 2)):
        told = [f"{channels[-1]} -2.0 sigma during 32 … 11 steps before the impact"]
        told += [f"{name} noise has no effect" for name in channels[:-1][: most - 1]]
        more = count - most
        told += [f"{more} further channel{'s' * (more > 1)} with less noise"] if more > 0 else []
        sentence = f"{'; '.join(told)}."
        assert words(z, IN_STEPS, channels) == f"{sentence[0].upper()}{sentence[1:]}"


def test_a_hand_made_push_is_told_as_it_is():
    assert describe_needed(hand_made(), Clock(STEPS, 0.1)) == (
        "Longitudinal +2.0 sigma (ahead), peak +2.9, during 3.2 … 1.1 s before the impact; "
        "lateral noise has no effect."
    )


def test_what_is_everywhere_is_told_by_its_strong_moments():
    z = 0.2 * np.sin(np.arange(STEPS * 2, dtype=np.float32)).reshape(STEPS, 2)
    z[30:36, 1] -= 1.5
    told = describe(z, Clock(STEPS, 0.1, "its medoid's impact"))
    assert told.startswith("Lateral -1.")
    assert "during 1.0 … 0.4 s before its medoid's impact; " in told
    assert "(to the right)" in told
    assert told.endswith("longitudinal noise stays within 0.2 sigma.")


def test_what_comes_after_the_impact_does_not_count():
    z = hand_made()
    z[35:, 1] = -9.0
    assert describe_needed(z, Clock(35, 0.1)) == describe_needed(z[:35], Clock(35, 0.1))
    assert "-9" not in describe_needed(z, Clock(35, 0.1))


def test_no_noise_is_said_to_be_none():
    nothing = np.zeros((STEPS, 2), np.float32)
    assert describe_needed(nothing, IN_STEPS) == "It needs no noise at all."
    assert describe(nothing, IN_STEPS) == (
        "Longitudinal noise has no effect; lateral noise has no effect."
    )


def test_pushes_of_one_sign_are_joined_over_a_short_pause_and_no_further():
    noise = np.zeros(STEPS, np.float32)
    noise[[5, 5 + JOINED + 1]] = 1.0
    (joined,) = find_pushes(noise, 0.0)
    assert (joined.first, joined.last, joined.steps) == (5, 5 + JOINED + 1, 2)
    noise[5 + JOINED + 1], noise[5 + JOINED + 2] = 0.0, 1.0
    assert len(find_pushes(noise, 0.0)) == 2


def agrees(sentence, z, levels, most):
    """Hold every figure of a sentence against the numbers, axis by axis."""
    for axis, name in enumerate(("longitudinal", "lateral")):
        part = next(p for p in sentence.lower().rstrip(".").split("; ") if p.startswith(name))
        noise = z[:, axis]
        strong = (noise != 0.0) & (np.abs(noise) >= levels[axis])
        assert ("has no effect" in part) == (not noise.any())
        if stays := re.search(r"stays within (\S+) sigma", part):
            assert np.abs(noise).max() <= float(stays[1]) < np.abs(noise).max() + 0.1 + 1e-6
            assert not strong.any()
            continue
        told = [match.groupdict() for match in TOLD.finditer(part)]
        covered = np.zeros(STEPS, bool)
        for one in told:
            window = slice(STEPS - int(one["since"]), STEPS - int(one["until"]))
            positive = one["way"] in ("ahead", "to the left")
            ours = noise[window][strong[window]]
            assert ((ours > 0.0) == positive).all()
            assert strong[window][0]
            assert strong[window][-1]
            assert float(one["mean"]) == pytest.approx(ours.mean(dtype=float), abs=0.0501)
            assert len(ours) == int(one["some"] or window.stop - window.start)
            if one["peak"]:
                peak = ours[np.abs(ours).argmax()]
                assert float(one["peak"]) == pytest.approx(float(peak), abs=0.0501)
            covered[window] = True
        if "weaker" not in part:
            assert covered[strong].all()
        else:
            assert len(told) == most


@given(noises)
@settings(max_examples=60, deadline=None)
def test_words_for_noise_that_is_everywhere_agree_with_it(z):
    strongest = np.abs(z).max(axis=0)
    levels = [TELLING * each if each >= FAINT else np.inf for each in strongest.astype(float)]
    agrees(describe(z, IN_STEPS), z, levels, MOST_PUSHES)


@given(sparse)
@settings(max_examples=60, deadline=None)
def test_words_for_a_minimal_failure_agree_with_it(z):
    if z.any():
        agrees(describe_needed(z, IN_STEPS), z, (0.0, 0.0), MOST_NEEDED)


def explained(*accounts):
    noise = NoiseTrajectory(np.zeros((4, 2), np.float32), np.ones((4, 2), np.float32))
    result = EpisodeResult(0, 0, Outcome.COLLISION, len(accounts), noise, "trajectory")
    steps = (
        ExplainedStep(0.1 * number, 0.0, 0.0, account, (0.0, 0.0))
        for number, account in enumerate(accounts)
    )
    return ExplainedEpisode(result, tuple(steps))


def test_the_account_says_what_decided_what_overrode_it_and_what_was_lost():
    told = describe_account(
        explained(
            {"rule": "keep_gap", "override": "none", "lost_tracks": 0.0},
            {"rule": "keep_gap", "override": "none", "lost_tracks": 1.0},
            {"rule": "comfort", "override": "emergency_brake", "lost_tracks": 1.0},
            {"rule": "keep_gap", "override": "emergency_brake", "lost_tracks": 2.0},
        ),
        Clock(4, 0.1),
    )
    assert told == (
        "the planner's rules that decided: keep gap in 3 of 4 steps, comfort in 1 of 4 steps; "
        "overridden by emergency brake in 2 steps during 0.2 … 0.0 s before the impact; "
        "it lost a track 2 times, the last 0.1 s before the impact."
    )


def test_what_is_no_number_counts_as_none_lost():
    steps = ({"lost_tracks": "none"}, {"lost_tracks": "1"}, {"lost_tracks": None}, {})
    assert describe_account(explained(*steps), Clock(4, 0.1)) == (
        "it lost a track once, 0.3 s before the impact."
    )


def test_a_planner_that_explains_nothing_is_not_spoken_for():
    assert describe_account(explained({}, {}), Clock(2, 0.1)) == ""


def test_events_are_told_by_when_they_last():
    z = np.full((STEPS, 3), -2.0, np.float32)
    z[8:12, 0], z[20:23, 0] = 2.0, 3.0
    z[0, 2], z[1:, 2] = 1.25, -3.0
    shape = PerChannel((Markov(0.05, 4.0), Markov(0.05, 4.0), Once()))
    channels = ("missed", "ghost", "scenario.gap_m")
    told = describe(z, IN_STEPS, channels, shape)
    assert "missed during 32 … 28 steps, during 20 … 17 steps before the impact" in told.lower()
    assert told.endswith("; 1 further channel with less noise.")
    assert "scenario.gap_m +1.2 sigma during 40 … 0 steps before the impact" in told.lower()
    assert "missed -2.0 sigma" in describe(z, IN_STEPS, channels).lower()
    two = describe(z[:, :2], IN_STEPS, channels[:2], PerChannel(shape.shapes[:2]))
    assert "ghost does not occur" in two
    assert two.endswith("unless most of its failures have it at the same step.")


def test_the_direction_is_that_of_any_vehicle():
    z = hand_made()
    told = describe(z, IN_STEPS, ("vehicle_2.longitudinal", "speed"))
    assert told.startswith("Vehicle_2.longitudinal +2.0 sigma (ahead)")
