"""The figures of methods that learn: what they are made of, by hand-made campaigns."""

import msgspec
import numpy as np
import pytest
from benchmarks.learning_figures import (
    count_trained,
    deviation,
    failure_rate,
    first_failure,
    log_p_per_step,
    log_p_ratio,
    middle,
    over_heuristics,
    severity,
)
from benchmarks.searches import Crash, Found, prior
from benchmarks.truth.curves import Curve, curve, picture
from benchmarks.truth.heuristics import Tried

from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.disturbance import NoiseTrajectory


def campaign(crashed, crashes=()):
    return Found(
        spec=CampaignSpec(name="made up", method="ast", episodes=len(crashed)),
        crashed=tuple(crashed),
        crashes=tuple(crashes),
        robustness_m=tuple(0.0 if one else 10.0 + i for i, one in enumerate(crashed)),
        mean_square_z=4.0,
        log_p_per_step=-2.0,
        trained_episodes=None,
        state=b"",
        digest="",
    )


def crash(log_probability, steps=10, prior=-20.0, severity=50.0):
    return Crash(np.zeros((steps, 2), np.float32), log_probability, prior, severity)


def test_the_prior_of_noise_is_its_log_probability_where_every_square_is_one():
    ones = NoiseTrajectory(np.ones((7, 2), np.float32), np.full((7, 2), 1.5, np.float32))
    large = msgspec.structs.replace(ones, z=3.0 * ones.z)
    assert prior(ones) == pytest.approx(ones.log_probability)
    assert prior(large) == pytest.approx(ones.log_probability)


def test_a_campaign_is_told_in_rates_likelihood_and_severity():
    run = campaign([False, True, False, True], [crash(-30.0), crash(-20.0, steps=5, severity=70.0)])
    assert failure_rate(run) == 0.5
    assert first_failure(run) == 2.0
    assert log_p_per_step(run) == pytest.approx(-50.0 / 15.0)
    assert log_p_ratio(run) == pytest.approx(50.0 / 40.0)
    assert severity(run) == 60.0
    assert deviation(run) == 2.0


def test_without_a_failure_there_is_nothing_to_tell_of_failures():
    run = campaign([False, False])
    told = (first_failure, log_p_per_step, log_p_ratio)
    assert [of(run) for of in (*told, severity, count_trained)] == [None] * 5


def test_the_median_of_the_seeds_is_stated_with_all_of_them():
    runs = [campaign([True] * k + [False] * (4 - k)) for k in (3, 1, 4)]
    figure = middle(runs, failure_rate, "share", 4)
    assert (figure.value, figure.spread, figure.n) == (0.75, (0.25, 1.0), 4)
    assert figure.note == "median of 3 seeds: 0.75, 0.25, 1"
    unknown = middle([*runs, campaign([False])], first_failure, "episode", 4)
    assert (unknown.value, unknown.spread) == (None, None)
    assert unknown.note.endswith("–")


def test_a_curve_has_a_point_for_each_hundred_episodes():
    crashed = [i >= 100 and i % 2 == 0 for i in range(250)]
    found = curve(campaign(crashed, [crash(-10.0 * (1 + i // 50)) for i in range(75)]))
    assert found.failure_rate == (0.0, 0.5, 0.5)
    assert found.log_p_per_step == (None, -1.0, -2.0)
    assert len(found.robustness_m) == 3


def test_the_picture_has_a_line_for_each_seed_broken_where_nothing_failed():
    whole = Curve((0.1, 0.2, 0.3), (-3.0, -2.0, -1.0), (30.0, 20.0, 10.0))
    broken = Curve((0.1, 0.0, 0.3), (-3.0, None, -1.0), (30.0, 20.0, 10.0))
    svg = picture({"ast": (whole, broken)})
    assert svg.count('<polyline class="believed"') == 3 + 4
    assert "ast: failure rate" in svg
    assert "300 episodes" in svg


def test_the_heuristic_to_beat_is_the_strongest_of_those_as_likely():
    tried = {
        "held": [Tried(1.0, 0.0, -2.0, 0.0), Tried(2.0, 0.2, -4.0, 0.0)],
        "squares": [Tried(1.0, 0.2, -1.0, 0.0), Tried(2.0, 0.6, -3.0, 0.0)],
    }
    run = campaign([True, True, True, False])
    assert over_heuristics(run, tried) == pytest.approx(0.75 / 0.4)
    never = {"held": [Tried(1.0, 0.0, -2.0, 0.0)]}
    assert over_heuristics(run, never) is None
