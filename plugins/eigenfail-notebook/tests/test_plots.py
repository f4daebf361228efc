"""Diagrams of values: what is drawn, by its data and words."""

import matplotlib as mpl
import msgspec
import numpy as np
import pytest
from matplotlib import pyplot as plt
from store_checks.examples import deliver, result, running

from eigenfail.errors import InvalidValue
from eigenfail.testing.examples import collision
from eigenfail.values.analysis import (
    Analysis,
    AnalysisResult,
    AnalysisSettings,
    AnalysisState,
    FailureMode,
)
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail_notebook import plot

mpl.use("Agg")


@pytest.fixture(autouse=True)
def no_figure_left():
    yield
    plt.close("all")


@pytest.fixture
def campaign(client, store):
    made = running(store, episodes=40, name="first")
    deliver(store, made, *(collision(n) if n % 4 == 0 else result(n) for n in range(10)))
    return client.campaigns.get(made.id)


def make_analysis(scores):
    result = AnalysisResult(
        episodes=(3, 7, 9),
        explained=np.ones(2, np.float32),
        components=np.ones((2, 4, 2), np.float32),
        scores=np.array(scores, np.float32),
        labels=(1, 0, 1),
        modes=(),
        influence=np.ones((4, 2), np.float32),
        silhouette=None,
        noise_silhouette=None,
    )
    return Analysis(5, 2, AnalysisSettings(), AnalysisState.DONE, 0, result)


def test_a_campaign_is_drawn_by_what_became_of_its_episodes(campaign):
    axes = plot(campaign)
    names = [label.get_text() for label in axes.get_yticklabels()]
    sizes = [bar.get_width() for bar in axes.patches]
    assert dict(zip(names, sizes, strict=True)) == {
        "failures": 3,
        "other completed": 7,
        "errored": 0,
        "cancelled or open": 30,
    }
    assert axes.get_title() == f"Campaign {campaign.id}: first"
    assert [text.get_text() for text in axes.texts] == ["3", "7", "0", "30"]


def test_a_course_is_drawn_with_the_intervals_that_it_has(client, campaign):
    course = client.campaigns.course(campaign, per=5)
    axes = plot(course)
    (points,) = axes.lines
    assert points.get_xydata().tolist() == [[2.0, 0.4], [7.0, 0.2]]
    (bars,) = axes.collections
    drawn = [segment[:, 1].tolist() for segment in bars.get_segments()]
    intervals = [block.failure_rate.interval for block in course.blocks]
    assert drawn == [[each.low, each.high] for each in intervals]
    searched = tuple(
        msgspec.structs.replace(
            block,
            failure_rate=msgspec.structs.replace(block.failure_rate, interval=None, sampled=False),
        )
        for block in course.blocks
    )
    assert not plot(msgspec.structs.replace(course, blocks=searched)).collections


def test_costs_and_severities_are_drawn_as_they_are(client, campaign):
    costs = client.campaigns.cost(campaign)
    axes = plot(costs)
    (line,) = axes.lines
    assert axes.get_ylabel() == "failures found"
    assert line.get_ydata().tolist() == [point.failures for point in costs.curve]
    safety = client.campaigns.safety(campaign)
    axes = plot(safety)
    (marks,) = axes.collections
    assert axes.get_title() == f"Campaign {campaign.id}: first, 3 failures"
    points = [[each.log_probability_per_step, each.severity] for each in safety.scatter.points]
    assert len(points) == 3
    assert np.allclose(marks.get_offsets(), points)


def test_a_comparison_has_its_two_sides(client, store, campaign):
    other = running(store, episodes=40, seed=8)
    deliver(store, other, *(result(n) for n in range(4)))
    axes = plot(client.campaigns.compare(campaign, other.id))
    assert axes.lines[0].get_xydata().tolist() == [[0.0, 0.3], [1.0, 0.0]]
    labels = [label.get_text() for label in axes.get_xticklabels()]
    assert labels == [f"A: {campaign.id}", f"B: {other.id}"]


def test_rates_begin_at_zero_and_none_is_cut_off(client, store, campaign):
    worse = running(store, episodes=40, seed=8)
    deliver(store, worse, *(collision(n) for n in range(10)))
    axes = plot(client.campaigns.course(campaign, per=5))
    assert axes.get_ylim()[0] == 0.0
    assert axes.get_title().startswith(f"Campaign {campaign.id}: ")
    plot(client.campaigns.course(worse.id, per=5), ax=axes)
    low, high = axes.get_ylim()
    assert (low, high > 1.0) == (0.0, True)
    compared = plot(client.campaigns.compare(campaign, worse.id))
    low, high = compared.get_ylim()
    assert (low, high > 1.0) == (0.0, True)
    assert not compared.lines[0].get_clip_on()


@pytest.mark.parametrize("components", [1, 2])
def test_an_analysis_is_drawn_mode_by_mode(components):
    scores = [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]
    axes = plot(make_analysis([row[:components] for row in scores]))
    first, second = axes.collections
    across = (4.0, [2.0, 6.0]) if components == 2 else (0.0, [0.0, 0.0])
    assert first.get_offsets().tolist() == [[3.0, across[0]]]
    assert second.get_offsets().tolist() == [[1.0, across[1][0]], [5.0, across[1][1]]]
    words = [text.get_text() for text in axes.get_legend().get_texts()]
    assert words == ["1: 1 failure", "2: 2 failures"]
    assert axes.get_title() == "Analysis 5: groups of failures"


def test_an_analysis_without_a_result_leaves_no_empty_figure():
    queued = Analysis(5, 2, AnalysisSettings(), AnalysisState.QUEUED, 0)
    with pytest.raises(InvalidValue, match="queued"):
        plot(queued)
    assert not plt.get_fignums()


def test_an_eigenfailure_is_drawn_with_its_band():
    z = np.array([[1.0, -1.0], [0.5, 2.0]], np.float32)
    mode = FailureMode(3, 7, np.ones(1, np.float32), z, band=np.stack([z - 1.0, z + 1.0]))
    axes = plot(mode)
    assert [line.get_label() for line in axes.lines[:2]] == ["longitudinal", "lateral"]
    assert axes.lines[1].get_ydata().tolist() == [-1.0, 2.0]
    assert len(axes.collections) == 2
    assert axes.collections[0].get_paths()[0].get_extents().ymin == -0.5
    assert "<th>medoid</th><td>episode 7</td>" in mode._repr_html_()
    assert "+2.00 at step 1" in mode._repr_html_()


def test_an_eigenfailure_ends_with_the_last_of_its_failures():
    z = np.zeros((6, 2), np.float32)
    z[:3, 0] = 1.0
    band = np.zeros((2, 6, 2), np.float32)
    band[1, :4, 1] = 0.5  # a failure whose median is zero at its last step
    mode = FailureMode(2, 7, np.ones(1, np.float32), z, 3, band=band)
    axes = plot(mode)
    assert [len(line.get_xdata()) for line in axes.lines[:2]] == [4, 4]
    assert axes.collections[0].get_paths()[0].get_extents().xmax == 3.0
    assert axes.get_title() == "Eigenfailure of 2 failures, medoid episode 3/7"
    short = plot(FailureMode(2, 7, np.ones(1, np.float32), z))
    assert len(short.lines[0].get_xdata()) == 3
    assert short.get_title() == "Eigenfailure of 2 failures, medoid episode 7"


def test_of_many_channels_those_with_the_strongest_noise_are_drawn():
    z = np.zeros((5, 6), np.float32)
    z[:, [4, 1, 3]] = [3.0, -2.0, 1.0]
    axes = plot(NoiseTrajectory(z, np.ones_like(z)))
    legend = axes.get_legend()
    assert [text.get_text() for text in legend.get_texts()] == [
        "channel_5",
        "channel_2",
        "channel_4",
    ]
    assert legend.get_title().get_text() == "3 of 6 channels"


def test_an_episode_is_drawn_with_its_own_channels(client, campaign):
    episode = client.episodes.get(campaign, 4)
    axes = plot(episode)
    assert axes.get_title() == f"Episode {campaign.id}/4: collision"
    for place, line in enumerate(axes.lines[: len(episode.channels)]):
        assert line.get_label() == episode.channels[place]
        assert np.array_equal(line.get_ydata(), episode.noise.z[:, place])
    z = np.ones((3, 3), np.float32)
    lines = plot(NoiseTrajectory(z, z)).lines
    assert [line.get_label() for line in lines[:3]] == ["channel_1", "channel_2", "channel_3"]


def test_a_diagram_may_be_drawn_beside_another_one(campaign):
    _, (left, right) = plt.subplots(1, 2)
    assert plot(campaign, right) is right
    assert plot(campaign, ax=right) is right
    assert not left.patches
    assert plt.get_fignums() == [1]


def test_what_cannot_be_drawn_is_refused():
    with pytest.raises(InvalidValue, match="nothing to draw in a int"):
        plot(3)
