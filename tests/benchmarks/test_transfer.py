"""The transfer of a policy: where it is trained, and that the judging episodes are long enough."""

from benchmarks.claims import SEED
from benchmarks.truth.transfer import JUDGED, LONG, PLACES, list_seeds, name_seeds, read_example

from eigenfail.values.variation import read_distribution
from eigenfail_workers.scenarios import DT_S
from eigenfail_workers.scenarios.cut_in import CutIn, CutInParameters


def test_training_covers_the_judged_range_and_the_default_gap():
    given = read_example().scenario_parameters
    trained = {name: read_distribution(one, name).ends() for name, one in given.items()}
    for name, one in JUDGED.items():
        low, high = read_distribution(one, name).ends()
        assert min(trained[name]) <= low < high <= max(trained[name]), name
    gap = CutInParameters().initial_gap_m
    assert min(trained["initial_gap_m"]) <= gap <= max(trained["initial_gap_m"])
    assert "initial_gap_m" not in JUDGED


def test_the_truck_reaches_the_car_at_every_place_before_the_episode_ends():
    gap, speeds = CutInParameters().initial_gap_m, ("ego_speed_mps", "actor_speed_mps")
    (slow, _), (_, fast) = (read_distribution(JUDGED[name], name).ends() for name in speeds)
    assert min(PLACES["ego_speed_mps"]) >= slow
    assert max(PLACES["actor_speed_mps"]) <= fast
    slowest = CutInParameters(ego_speed_mps=slow, actor_speed_mps=fast)
    assert gap / (slow - fast) > CutIn()(slowest, 0).steps * DT_S
    longer = CutInParameters(ego_speed_mps=slow, actor_speed_mps=fast, **LONG)
    assert gap / (slow - fast) < CutIn()(longer, 0).steps * DT_S - 2.0


def test_the_seeds_of_the_figures_are_named_and_are_not_those_of_the_tuning():
    looked_at = {
        *range(20261122, 20261211),
        *range(20263001, 20263011),
        *range(20270001, 20270017),
        *range(20291201, 20291211),
    }
    judged = list_seeds(SEED)
    assert looked_at.isdisjoint(judged)
    assert name_seeds(SEED) == "20301201 to 20301210"
