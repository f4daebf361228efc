"""Which campaigns' costs are held against each other."""

import msgspec
import pytest
from accepted import accept_spec
from store_checks.examples import deliver, running

from eigenfail.testing.examples import collision, result, spec
from eigenfail.values.comparison import Peers, Pool
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail_services.comparison.peers import compare_peers
from eigenfail_services.comparison.seeds import find_spreads
from eigenfail_services.store.store import open_store

PEERS = Peers(
    planner="idm",
    planner_settings={},
    scenario="cut_in",
    scenario_parameters={},
    simulator="highway",
    disturbance=DisturbanceModel(),
)


def pool(newest, method="monte_carlo", failures=1, **peers):
    return Pool(
        peers=msgspec.structs.replace(PEERS, **peers),
        method=method,
        campaigns=1,
        newest=newest,
        completed=10,
        failures=failures,
        judges_failures=False,
        instance_hours=2.0,
        total_usd=3.0,
    )


WRITTEN = {"scenario_parameters": {"distance_m": 58.0}}
OTHER = {"scenario_parameters": {"distance_m": 63.0}}


def test_a_default_that_is_written_down_makes_no_other_peer():
    (group,) = compare_peers([pool(2, "ast", **WRITTEN), pool(1)])
    assert [found.method for found in group.methods] == ["monte_carlo", "ast"]
    assert group.peers.scenario_parameters == {}


def test_campaigns_of_one_method_are_summed_then():
    (group,) = compare_peers([pool(2, failures=3, **WRITTEN), pool(1)])
    (found,) = group.methods
    assert (found.campaigns, found.newest, found.completed, found.failures) == (2, 2, 20, 4)
    assert found.cost.total_usd == pytest.approx(6.0)


def test_another_value_does_and_the_newest_come_first():
    groups = compare_peers([pool(3), pool(2, **OTHER), pool(1, **WRITTEN)])
    assert [group.peers.scenario_parameters for group in groups] == [{}, {"distance_m": 63.0}]


def test_of_a_scenario_that_is_not_installed_everything_stays():
    unknown = {"scenario": "nowhere", **WRITTEN}
    (group,) = compare_peers([pool(1, **unknown)])
    assert group.peers.scenario_parameters == {"distance_m": 58.0}


@pytest.mark.parametrize(
    ("planner_settings", "same"),
    [
        ({"time_headway_s": 1.5}, True),
        ({"time_headway_s": 1.5, "standstill_gap_m": 2}, True),
        ({"gaps": {}}, True),
        ({"time_headway_s": 1.25}, False),
    ],
)
def test_a_planners_default_that_is_written_down_makes_no_other_peer(planner_settings, same):
    groups = compare_peers([pool(2, planner_settings=planner_settings), pool(1)])
    assert len(groups) == (1 if same else 2)
    assert groups[-1].peers.planner_settings == {}


def test_a_number_is_one_however_it_is_written():
    ways = [{"planner_settings": {"time_headway_s": value}} for value in (3, 3.0)]
    assert len(compare_peers([pool(n, **peers) for n, peers in enumerate(ways)])) == 1


@pytest.fixture(params=["memory://", "sqlite"])
def store(request, tmp_path):
    at = {"sqlite": f"sqlite:///{tmp_path / 'a.db'}"}
    store = open_store(at.get(request.param, request.param))
    yield store
    store.close()


WHITE = {"scale": 1.0, "longitudinal_slope": 0.02, "shape": {"kind": "white"}}


@pytest.mark.parametrize(
    ("disturbance", "groups"), [(WHITE, 1), ({**WHITE, "scale": 1.5}, 2), ({"scale": 1}, 1)]
)
def test_a_disturbance_default_that_is_written_down_makes_no_other_peer(store, disturbance, groups):
    given = msgspec.convert(disturbance, DisturbanceModel)
    running(store, disturbance=given)
    store.campaigns.create(accept_spec(spec(method="ast")))
    assert len(compare_peers(store.figures.pools())) == groups


def test_a_distribution_is_a_value_of_its_own():
    drawn = {"distance_m": {"uniform": [50.0, 60.0]}}
    (group,) = compare_peers(
        [pool(2, scenario_parameters=drawn), pool(1, scenario_parameters=drawn)]
    )
    assert group.peers.scenario_parameters == drawn


def search(store, seed, failures, **changes):
    """A search that is done: ten episodes, the first of which failed, at 1.5 USD and more."""
    fields = {"method": "cem", "seed": seed, "price_usd_per_hour": 1.5}
    campaign = running(store, **fields | changes)
    deliver(store, campaign, *(collision(n) if n < failures else result(n) for n in range(10)))
    store.campaigns.add_active(campaign.id, 3600.0 * (1.0 + 0.1 * seed))
    return campaign.id


def price(store):
    """The cost of the only method."""
    ((found,),) = [group.methods for group in compare_peers(store.figures.pools())]
    return found


def test_a_search_over_seeds_has_the_interval_of_its_campaigns(store):
    ids = [search(store, seed, failures) for seed, failures in ((0, 4), (1, 6), (2, 5), (3, 5))]
    found, (spread,) = price(store), find_spreads(store, ids)
    assert found.seeds == 4
    assert found.cost.interval_usd.low < found.cost.per_failure_usd
    for name in ("per_failure_usd", "total_usd", "at_least_usd", "instance_hours"):
        assert getattr(found.cost, name) == pytest.approx(getattr(spread.cost, name))
    assert found.cost.interval_usd.high == pytest.approx(spread.cost.interval_usd.high)


def test_without_a_failure_the_seeds_bound_its_cost(store):
    ids = [search(store, seed, 0) for seed in range(3)]
    found, (spread,) = price(store), find_spreads(store, ids)
    assert found.cost.per_failure_usd is None
    assert found.cost.at_least_usd == pytest.approx(spread.cost.at_least_usd)


@pytest.mark.parametrize(
    "other",
    [
        {"settings": {"elite": 0.5}},
        {"episodes": 20},
        {"price_usd_per_hour": 2.0},
        {"seed": 0},
    ],
)
def test_campaigns_that_differ_in_more_have_no_interval_across_seeds(store, other):
    search(store, 0, 4)
    search(store, **{"seed": 1, "failures": 6} | other)
    found = price(store)
    assert (found.seeds, found.failures) == (0, 10)
    assert (found.cost.interval_usd, found.cost.at_least_usd) == (None, None)


def test_a_campaign_that_has_not_begun_does_not_count_and_one_in_vain_leaves_no_interval(store):
    search(store, 0, 4)
    search(store, 1, 6)
    store.campaigns.create(accept_spec(spec(method="cem", seed=2, episodes=20)))
    assert price(store).seeds == 2
    in_vain = running(store, method="cem", seed=3, price_usd_per_hour=1.5)
    store.campaigns.add_active(in_vain.id, 60.0)
    assert price(store).seeds == 0


def test_random_episodes_keep_the_interval_of_their_rate(store):
    for seed in (0, 1):
        search(store, seed, 4 + seed, method="monte_carlo")
    found = price(store)
    assert found.seeds == 0
    assert found.cost.at_least_usd == pytest.approx(3.15 / (20 * found.failure_rate.interval.high))
