"""Campaigns on a bridge: the same episodes as built in, whatever runs beside them."""

from functools import cache

import pytest

from eigenfail.contracts import LockstepEngine
from eigenfail.values import episode
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail_workers.engine import Engine

NOISY = DisturbanceModel(scale=2.0)
IN_BATCHES_OF = (1, 5, 16)
EPISODES = 18
"""Of which the last batch has fewer than the others."""


def tasks(episodes: int) -> list[episode.EpisodeTask]:
    return [
        episode.EpisodeTask(i, episode.episode_seed(5, i), episode.PriorSource())
        for i in range(episodes)
    ]


def built_in(planner: str, **changes) -> Engine:
    given = {"simulator": "highway", "scenario": "cut_in", "scenario_parameters": {}}
    rest = {"planner": planner, "planner_settings": {}, "disturbance": NOISY}
    return Engine(episode.EpisodeSetup(**(given | rest | changes)))


@cache
def find_expected(planner: str) -> list[str]:
    """The digests of a planner's episodes in the built-in world."""
    return [each.digest() for each in built_in(planner).run(tasks(24))]


@pytest.mark.parametrize("planner", ["idm", "rulebook"])
def test_episodes_are_those_of_the_same_world_built_in(planner, serving, on_bridge) -> None:
    with serving() as address:
        engine = on_bridge(address, planner, disturbance=NOISY)
        results = list(engine.run(tasks(24)))
    assert [each.digest() for each in results] == find_expected(planner)
    failures = sum(each.is_failure for each in results)
    assert failures >= (5 if planner == "idm" else 1)


def test_an_episode_does_not_depend_on_its_neighbours(serving, on_bridge) -> None:
    found = []
    for slots in IN_BATCHES_OF:
        with serving(slots=slots) as address:
            results = list(on_bridge(address, disturbance=NOISY).run(tasks(EPISODES)))
        assert [each.index for each in results] == list(range(EPISODES))
        found.append([each.digest() for each in results])
    with serving(slots=5) as address:
        backwards = list(on_bridge(address, disturbance=NOISY).run(tasks(EPISODES)[::-1]))
    assert found == [[each.digest() for each in backwards[::-1]]] * len(IN_BATCHES_OF)


def test_parameters_are_drawn_here_and_told_to_the_bridge(serving, on_bridge) -> None:
    varied = {"steps": 100, "distance_m": {"uniform": [56.0, 60.0]}}
    inside = {"distance_m": {"uniform": [56.0, 60.0]}}
    expected = [each.digest() for each in built_in("idm", scenario_parameters=inside).run(tasks(8))]
    with serving() as address:
        engine = on_bridge(address, disturbance=NOISY, scenario_parameters=varied)
        assert [each.digest() for each in engine.run(tasks(8))] == expected


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"scenario": "cutin"}, "scenario: 'cutin' is not known to the bridge 'minimal'"),
        ({"planner": "autoware"}, "planner: 'autoware' is not known to the"),
        ({"scenario_parameters": {"steps": 100, "gap": 1.0}}, "scenario_parameters: 'gap' is not"),
        (
            {"scenario_parameters": {"steps": 101}},
            "'minimal' (version 1) has no more than 100 steps",
        ),
        ({"scenario_parameters": {"steps": 9, "dt_s": 0.2}}, "takes 0.1 s, and not 0.2 s."),
        ({"planner_settings": {"speed": 1.0}}, "planner_settings: 'speed' is not known to the"),
        ({"scenario_parameters": {"steps": 9, "distance_m": 9.0}}, "bridge: parameters.distance_m"),
    ],
)
def test_what_the_bridge_does_not_know_is_the_campaigns_fault(
    changes, said, serving, on_bridge
) -> None:
    with serving() as address:
        (result,) = on_bridge(address, **changes).run(tasks(1))
        assert result.outcome is episode.Outcome.ERRORED
        assert result.fault.kind == "input"
        assert said in result.fault.message
        (usual,) = on_bridge(address).run(tasks(1))
        assert usual.fault is None


def test_a_policy_that_nobody_sent_is_the_inputs_fault_and_the_others_run(serving, on_bridge):
    unknown = episode.EpisodeTask(1, 7, episode.PolicySource(3))
    known = episode.EpisodeTask(2, 8, episode.PriorSource())
    with serving() as address:
        results = list(on_bridge(address).run([*tasks(1), unknown, known]))
    assert [each.fault and each.fault.kind for each in results] == [None, "input", None]


def test_it_is_an_engine_that_runs_episodes_side_by_side(serving, on_bridge) -> None:
    with serving(slots=3) as address:
        engine = on_bridge(address)
        assert isinstance(engine, LockstepEngine)
        assert engine.room == 1  # how many there are, the bridge has not told yet
        for task in tasks(3):
            engine.begin(task)
        assert engine.room == 0
        finished = []
        while len(finished) < 3:
            finished += engine.turn()
        assert sorted(each.index for each in finished) == [0, 1, 2]
        assert engine.room == 3
