"""Which campaigns' costs are held against each other."""

import msgspec
import pytest
from store_checks.examples import running

from eigenfail.testing.examples import spec
from eigenfail.values.comparison import Peers, Pool
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail_services.campaigns.costs import compare_peers
from eigenfail_services.store import open_store

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
        ends_at_failures=False,
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
    store.campaigns.create(spec(method="ast"))
    assert len(compare_peers(store.figures.pools())) == groups


def test_a_distribution_is_a_value_of_its_own():
    drawn = {"distance_m": {"uniform": [50.0, 60.0]}}
    (group,) = compare_peers(
        [pool(2, scenario_parameters=drawn), pool(1, scenario_parameters=drawn)]
    )
    assert group.peers.scenario_parameters == drawn
