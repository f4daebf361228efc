"""Campaigns over seeds: who is grouped, and what is said of them."""

from typing import Any

import pytest
from store_checks.examples import deliver, running

from eigenfail.errors import NotFound
from eigenfail.presentation.seeds import list_spread
from eigenfail.presentation.tables import format_cell
from eigenfail.testing.examples import collision, make_errored_result, result
from eigenfail.values.campaign import Campaign, CampaignState
from eigenfail.values.campaign_spec import Priority
from eigenfail_services.comparison.comparability import group_alike
from eigenfail_services.comparison.seeds import OF_THE_SEARCH, find_spreads, make_suite_table
from eigenfail_services.comparison.sides import group_by_seed
from eigenfail_services.statistics.intervals import rate
from eigenfail_services.statistics.seed_spread import PairSums, find_ratio, measure_spread
from eigenfail_services.store.store import Store

SEARCH = "cem"
LENGTH = 10
ACTIVE_S = 3_600.0


def search(store: Store, seed: int, crashed: str, **changes: Any) -> Campaign:
    """A campaign that is done; of its episodes those crashed that have an x."""
    fields = {"name": f"s: {seed} {changes}", "method": SEARCH, "seed": seed, "episodes": LENGTH}
    campaign = running(store, **fields | {"price_usd_per_hour": 1.5} | changes)
    made = [collision(n) if mark == "x" else result(n) for n, mark in enumerate(crashed)]
    deliver(store, campaign, *made)
    store.campaigns.add_active(campaign.id, ACTIVE_S * (1.0 + 0.1 * seed))
    return store.campaigns.move(campaign.id, CampaignState.DONE)


def ids(campaigns: list[Campaign]) -> list[int]:
    return [campaign.id for campaign in campaigns]


def test_figures_over_seeds_are_those_of_the_statistics(store: Store) -> None:
    crashed = ["..x.......", ".....xx...", "xxxx......"]
    made = [search(store, seed, marks) for seed, marks in enumerate(crashed)]
    (found,) = find_spreads(store, ids(made))
    assert (found.name, found.method) == (SEARCH, SEARCH)
    assert (found.campaigns, found.seeds) == ((1, 2, 3), (0, 1, 2))
    assert (found.completed, found.failures) == (30, 7)
    assert found.share == measure_spread([0.1, 0.2, 0.4], 0.0, 1.0)
    assert (found.worst.seed, found.worst.campaign, found.worst.value) == (0, 1, 0.1)
    assert (found.first.median, found.first.worst, found.first.worst_seed) == (3.0, 6, 1)
    prices = [1.5, 1.65, 1.8]
    ratio = find_ratio(PairSums.of(prices, [1, 2, 4]))
    assert found.cost.total_usd == pytest.approx(4.95)
    assert found.cost.per_failure_usd == pytest.approx(4.95 / 7)
    assert found.cost.at_least_usd == pytest.approx(ratio.at_least)
    assert found.cost.interval_usd == ratio.interval
    assert found.mean_severity.is_constant
    assert found.notes == (OF_THE_SEARCH,)


def test_seed_whose_episodes_all_errored_counts_in_the_pooled_upper_bound(store: Store) -> None:
    made = [search(store, seed, "." * LENGTH, method="monte_carlo") for seed in range(2)]
    fields = {"method": "monte_carlo", "episodes": LENGTH, "price_usd_per_hour": 1.5}
    lost = running(store, name="lost", seed=2, **fields)
    deliver(store, lost, *map(make_errored_result, range(LENGTH)))
    made.append(store.campaigns.move(lost.id, CampaignState.DONE))
    (found,) = find_spreads(store, ids(made))
    assert found.pooled == rate(0, 20, LENGTH)
    assert any("0 of 20, 10 errored" in note for note in found.notes)


def test_groups_are_those_of_a_comparison(store: Store) -> None:
    made = [
        search(store, seed, "x", episodes=1, scenario_parameters={"distance_m": distance_m})
        for distance_m in (53.0, 60.0)
        for seed in (1, 2)
    ]
    grouped = [ids(list(group)) for group in group_by_seed(made)]
    assert grouped == [[1, 2], [3, 4]]
    assert [ids(list(group)) for group in group_by_seed(made[:2])] == [[1], [2]]
    found = find_spreads(store, ids(made))
    assert [list(spread.campaigns) for spread in found] == grouped
    assert [spread.name for spread in found] == ["distance_m=53", "distance_m=60"]


def test_labels_name_no_group(store: Store) -> None:
    made = [
        search(store, seed, "x", episodes=1, method=method, tags=(f"{method}-{seed}",))
        for method in ("monte_carlo", "cem")
        for seed in (1, 2)
    ]
    found = find_spreads(store, ids(made))
    assert [spread.name for spread in found] == ["method=monte_carlo", "method=cem"]


def test_a_default_that_is_written_down_and_labels_make_no_difference(store: Store) -> None:
    made = [
        search(store, 1, "x", episodes=1, method="monte_carlo"),
        search(
            *(store, 2, "x"),
            episodes=1,
            method="monte_carlo",
            settings={"round_size": 100},
            priority=Priority.HIGH,
            project="fusion",
            tags=("nightly",),
            scene_every=7,
        ),
    ]
    assert len(group_alike(made)) == 1
    (found,) = find_spreads(store, ids(made))
    assert found.seeds == (1, 2)


@pytest.mark.parametrize("crashed", [["x.", "x."], ["..", ".."]])
def test_equal_shares_have_no_interval(store: Store, crashed: list[str]) -> None:
    made = [search(store, seed, marks) for seed, marks in enumerate(crashed)]
    (found,) = find_spreads(store, ids(made))
    assert found.share.is_constant
    assert found.share.interval is None


def test_seeds_without_a_failure_count(store: Store) -> None:
    made = [search(store, seed, marks) for seed, marks in enumerate(["....", "...x", "xx.."])]
    (found,) = find_spreads(store, ids(made))
    assert found.share.n == 3
    assert found.share.least == 0.0
    assert found.worst.seed == 0
    assert (found.first.median, found.first.worst, found.first.without) == (4.0, None, 1)
    assert (found.first.worst_seed, found.first.within) == (0, 4)
    assert found.cost.per_failure_usd == pytest.approx(4.95 / 3)
    assert found.mean_severity.n == 2


def test_where_most_seeds_find_nothing_the_first_failure_has_no_median(store: Store) -> None:
    made = [search(store, seed, marks) for seed, marks in enumerate([".", "..", "x", "..."])]
    (found,) = find_spreads(store, ids(made))
    assert (found.first.median, found.first.without) == (None, 3)
    assert (found.first.worst_seed, found.first.within) == (3, 3)


def test_without_any_failure_the_seeds_of_a_search_bound_the_cost(store: Store) -> None:
    made = [search(store, seed, "." * LENGTH) for seed in range(3)]
    (found,) = find_spreads(store, ids(made))
    # With 95 % a seed finds failures with a probability of at most 1 − 0.05^(1/3), then 10 of 10.
    assert found.cost.at_least_usd == pytest.approx(4.95 / (30 * (1.0 - 0.05 ** (1 / 3))))
    assert (found.cost.per_failure_usd, found.cost.interval_usd) == (None, None)
    assert found.log_probability_per_step is None


def test_without_any_failure_random_episodes_bound_the_cost_by_their_number(store: Store) -> None:
    made = [search(store, seed, "." * LENGTH, method="monte_carlo") for seed in range(3)]
    (found,) = find_spreads(store, ids(made))
    assert found.cost.at_least_usd == pytest.approx(4.95 / (30 * (1.0 - 0.05 ** (1 / 30))))
    # 1 − 0.05^(1/30)
    (note,) = found.notes
    assert "together their failure rate is 0 of 30: ≤ 9.51 %. Quote this interval" in note
    assert found.pooled == rate(0, 30)
    assert format_cell(list_spread(found)[2]).value == "≤ 9.51 %"


def test_what_is_open_missing_or_unequal_is_said(store: Store) -> None:
    search(store, 1, "x.")
    search(store, 2, "x")
    empty = running(store, name="none", method=SEARCH, seed=3, price_usd_per_hour=1.5)
    deliver(store, empty, make_errored_result(0))
    going_on = running(store, name="open", method=SEARCH, seed=4, price_usd_per_hour=1.5)
    deliver(store, going_on, collision(0))
    search(store, 2, "x..", name="again")
    (found,) = find_spreads(store, [1, 2, 3, 4, 5])
    assert (found.seeds, found.campaigns) == ((1, 2, 4), (1, 5, 4))
    assert found.notes[1:] == (
        "No episode is completed with seed 3: the figures are of the other 3.",
        "Campaigns with the seed of another one are not counted twice: 1 left out.",
        "1 of 3 campaigns have not ended: figures may still change.",
        "The seeds have 1 to 3 completed episodes; each counts alike in a mean.",
    )


def test_one_seed_or_no_episode_is_no_group(store: Store) -> None:
    search(store, 1, "x")
    search(store, 1, "x", name="again")
    search(store, 2, "x", planner="idm")
    running(store, name="no episode", method="ast", seed=1)
    running(store, name="none either", method="ast", seed=2)
    assert find_spreads(store, [1, 2, 3, 4, 5]) == ()
    with pytest.raises(NotFound):
        find_spreads(store, [1, 99])


def test_a_suite_has_the_same_value(store: Store) -> None:
    made = [search(store, seed, marks) for seed, marks in enumerate(["x.", "xx"])]
    assert make_suite_table(store, "s").over_seeds == find_spreads(store, ids(made))


def test_a_group_with_defaults_alone_is_called_so(store: Store) -> None:
    for seed in (1, 2):
        search(store, seed, "x")
        search(store, seed, "x", settings={"elite": 0.5})
    names = [spread.name for spread in make_suite_table(store, "s").over_seeds]
    assert names == ["defaults", "elite=0.5"]
