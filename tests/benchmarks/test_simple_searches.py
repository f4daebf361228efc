"""What is counted when searches are compared: regions of functions, distances of failures."""

import numpy as np
import pytest
from benchmarks.peers.simple_searches import FUNCTIONS, count_regions, find_distance
from benchmarks.searches import Crash, Found

from eigenfail.values.campaign_spec import CampaignSpec


def found(noise):
    crashes = tuple(Crash(np.array(z, np.float32), -1.0, -1.0, 0.0) for z in noise)
    spec = CampaignSpec(name="n", method="held", episodes=len(noise))
    return Found(spec, (True,) * len(noise), crashes, (0.0,) * len(noise), 1.0, -1.0, None, b"", "")


def test_the_distance_is_the_mean_over_pairs_on_the_steps_that_both_have():
    one, two, three = [[0.0, 0.0]], [[3.0, 1.0], [9.0, 9.0]], [[0.0, 0.0], [9.0, 7.0]]
    expected = np.mean([5.0**0.5, 0.0, (14.0 / 4.0) ** 0.5])
    assert find_distance(found([one, two, three])) == pytest.approx(expected)
    assert find_distance(found([one])) is None


def test_failures_of_a_function_lie_in_the_region_that_fails():
    """Noise that fails by one branch alone is counted for that branch."""

    reaches = {"corners": ([-4, 4], [4, 4]), "four_branches": ([4, 4], [-4, -4], [-4, 4], [4, -4])}
    for place, points in reaches.items():
        function = FUNCTIONS[place]
        z = np.array(points, float)[:, None]
        assert (function.make().robustness(z) <= 0.0).all()
        assert [function.find_region(one) for one in z] == list(range(len(z)))
    sides = [FUNCTIONS["walk"].find_region(np.full((30, 2), push)) for push in (-1.0, 1.0)]
    assert sides == [0, 1]


def test_a_region_counts_from_a_twentieth_of_the_failures_on():
    left, right = [[-4.0, 4.0]], [[4.0, 4.0]]
    assert count_regions("corners", found([left] * 19 + [right])) == 2
    assert count_regions("corners", found([left] * 20 + [right])) == 1
    assert count_regions("corners", found([])) == 0
