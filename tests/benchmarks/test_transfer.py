"""The transfer of a policy: where it is trained, and which draws of the judged range count."""

import pytest
from benchmarks.claims import SEED
from benchmarks.truth.transfer import JUDGED, is_reachable, list_seeds, name_seeds, read_example

from eigenfail.values.variation import read_distribution
from eigenfail_workers.scenarios.cut_in import CutInParameters


def test_training_covers_the_judged_range_and_the_default_gap():
    given = read_example().scenario_parameters
    trained = {name: read_distribution(one, name).ends() for name, one in given.items()}
    for name, one in JUDGED.items():
        low, high = read_distribution(one, name).ends()
        assert min(trained[name]) <= low < high <= max(trained[name]), name
    gap = CutInParameters().initial_gap_m
    assert min(trained["initial_gap_m"]) <= gap <= max(trained["initial_gap_m"])
    assert "initial_gap_m" not in JUDGED


@pytest.mark.parametrize(("closing_mps", "reached"), [(9.39, False), (9.41, True)])
def test_a_truck_reaches_the_car_if_it_closes_the_gap_of_94_m_within_10_s(closing_mps, reached):
    # At a distance of 64 m the episode has its least length: 30 m / 9.4 m/s + 3 s + 3 s < 10 s.
    parameters = CutInParameters(
        distance_m=64.0, ego_speed_mps=13.0 + closing_mps, actor_speed_mps=13.0
    )
    assert is_reachable(parameters) is reached


def test_the_seeds_of_the_figures_are_named_and_are_not_those_of_the_tuning():
    looked_at = {*range(20261122, 20261211), *range(20263001, 20263011), *range(20270001, 20270017)}
    judged = list_seeds(SEED)
    assert looked_at.isdisjoint(judged)
    assert name_seeds(SEED) == f"{judged[0]} to {judged[-1]}"
