"""Failures side by side, and back to where they can be injected."""

from typing import Any

import numpy as np
import pytest

from eigenfail.errors import UnknownName
from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.records import Failures
from eigenfail_services.analysis.alignment import (
    Aligned,
    FailureBatch,
    choose_columns,
    gather_failures,
    select_latest,
    select_samples,
)

SHORT = np.array([[1, -1], [2, -2]], np.float32)
LONG = np.array([[3, -3], [4, -4], [5, -5]], np.float32)
BOTH = Failures((4, 9), (SHORT, LONG))


def align(failures: Failures, horizon: int, how: Any, axes: Any = "joint") -> Aligned:
    """Gathered, and in the order of the episodes."""
    asked = AnalysisSettings(align=how, axes=axes)
    found = gather_failures([FailureBatch(1, failures)], horizon, asked)
    order = found.order
    return found._replace(
        episodes=found.episodes[order], steps=found.steps[order], noise=found.noise[order]
    )


def test_at_the_start_no_noise_follows_the_collision() -> None:
    aligned = align(BOTH, 4, "start")
    assert aligned.noise[0].tolist() == [[1, -1], [2, -2], [0, 0], [0, 0]]
    assert aligned.noise[1].tolist() == [[3, -3], [4, -4], [5, -5], [0, 0]]
    assert aligned.data[0].tolist() == [1, -1, 2, -2, 0, 0, 0, 0]
    assert (aligned.episodes.tolist(), aligned.steps.tolist()) == ([4, 9], [2, 3])


def test_at_the_collision_the_last_steps_meet() -> None:
    aligned = align(BOTH, 4, "collision")
    assert aligned.noise[0].tolist() == [[0, 0], [0, 0], [1, -1], [2, -2]]
    assert aligned.noise[1].tolist() == [[0, 0], [3, -3], [4, -4], [5, -5]]


@pytest.mark.parametrize("how", ["start", "collision"])
@pytest.mark.parametrize("row", [0, 1])
def test_the_way_back_gives_the_episode_as_it_was(how: str, row: int) -> None:
    aligned = align(BOTH, 4, how)
    z = aligned.injectable(aligned.noise[row], np.array([row]))
    steps = len(BOTH.noise[row])
    assert z.shape == (4, 2)
    assert np.array_equal(z[:steps], BOTH.noise[row])
    assert not z[steps:].any()


def gather_two_campaigns() -> Aligned:
    """Failures whose noise is the number of their episode."""
    batches = [
        FailureBatch(campaign, Failures(indices, tuple(np.full((2, 2), i) for i in indices)))
        for campaign, indices in ((1, (3, 5, 8, 30)), (2, (1, 2, 40)))
    ]
    return gather_failures(batches, 4, AnalysisSettings())


@pytest.mark.parametrize(("learning", "left"), [((), 7), ((1,), 5), ((2,), 6), ((1, 2), 4)])
def test_the_earlier_half_of_the_failures_of_a_campaign_is_left_out(learning, left) -> None:
    found = select_latest(gather_two_campaigns(), learning)
    kept = sorted(zip(found.campaigns.tolist(), found.episodes.tolist(), strict=True))
    assert len(kept) == left
    assert [index for campaign, index in kept if campaign == 1] == (
        [8, 30] if 1 in learning else [3, 5, 8, 30]
    )
    assert [index for campaign, index in kept if campaign == 2] == (
        [2, 40] if 2 in learning else [1, 2, 40]
    )
    assert [z[0, 0] for z in found.noise] == found.episodes.tolist()
    assert found.steps.tolist() == [2] * left


@pytest.mark.parametrize(
    ("first_samples", "kept"),
    [
        ({}, [3, 5, 8, 30, 1, 2, 40]),
        ({1: 8}, [8, 30, 1, 2, 40]),
        ({1: 6, 2: 3}, [8, 30, 40]),
        ({1: 31}, [3, 5, 8, 30, 1, 2, 40]),
    ],
)
def test_failures_of_a_campaign_before_its_first_sample_are_left_out(first_samples, kept) -> None:
    """Where there is none from there on, all of them stay."""
    found = select_samples(gather_two_campaigns(), first_samples)
    assert sorted(found.episodes.tolist()) == sorted(kept)
    assert [z[0, 0] for z in found.noise] == found.episodes.tolist()


VEHICLES = (
    *("vehicle_1.lateral", "vehicle_2.lateral", "ego.speed", "longitudinal"),
    *("vehicle_2.longitudinal", "vehicle_3.lateral"),
)


@pytest.mark.parametrize(
    ("axes", "columns"),
    [
        ("joint", (0, 1, 2, 3, 4, 5)),
        ("vehicle_2.lateral", (1,)),
        ("every.lateral", (0, 1, 5)),
        ("every.longitudinal", (4,)),
        ("longitudinal", (3,)),
    ],
)
def test_the_noise_of_all_vehicles_is_analysed_by_quantity(axes, columns) -> None:
    assert choose_columns(axes, VEHICLES) == columns


@pytest.mark.parametrize("axes", ["every.speed", "every.", "lateral"])
def test_a_quantity_that_no_vehicle_has_is_refused(axes) -> None:
    with pytest.raises(UnknownName, match=r"every\.lateral"):
        choose_columns(axes, VEHICLES)
