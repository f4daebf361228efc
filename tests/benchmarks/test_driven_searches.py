"""Searches on the drive and behind SUMO: equal budgets, causes, and what is compared."""

import numpy as np
import pytest
from benchmarks.figures import Figure
from benchmarks.learning_figures import of_seeds
from benchmarks.peers import driven_searches
from benchmarks.peers.comparison import count_cells
from benchmarks.peers.driven_searches import DRIVEN, DrivenRun, count_causes, describe_driven
from benchmarks.peers.simple_searches import FUNCTIONS, PLACES, SEARCHES, list_searches
from benchmarks.searches import Crash

CALLS = 3


def make_run(*causes, cpu_s=0.0):
    z = np.zeros((1, 2), np.float32)
    crashes = tuple(Crash(z, -1.0, -1.0, 0.0, cause=cause) for cause in causes)
    return DrivenRun((True,) * len(causes) + (False,), crashes, cpu_s)


def test_causes_are_counted_once_each():
    assert [count_causes(make_run(*causes)) for causes in ("", "aab", "abc")] == [0, 2, 3]


def test_computing_time_is_per_episode_and_causes_need_labels():
    calls = DRIVEN["sumo"].calls
    runs = [make_run(*causes, cpu_s=calls * 1e-3 * n) for n, causes in enumerate(("a", "ab", "b"))]
    found = dict(describe_driven("sumo", "held", runs))
    assert found["search.sumo.held.cpu_ms"].value == pytest.approx(1.0)
    assert found["search.sumo.held.causes"].value == 1.0
    assert {figure.n for figure in found.values()} == {calls}
    unlabelled = dict(describe_driven("sumo", "held", [make_run(None)]))
    assert "search.sumo.held.causes" not in unlabelled
    assert unlabelled["search.sumo.held.failures"].value == 1.0


def test_a_campaign_on_the_drive_has_noise_on_every_vehicle_and_labels(monkeypatch):
    whole = driven_searches.DRIVEN["highway_drive"]
    monkeypatch.setitem(driven_searches.DRIVEN, "highway_drive", whole._replace(calls=CALLS))
    run, again = driven_searches.find("highway_drive", "held", [20261122] * 2)
    assert len(run.crashed) == CALLS
    assert run.cpu_s > 0.0
    assert again.crashed == run.crashed
    for one, other in zip(run.crashes, again.crashes, strict=True):
        assert one.z.shape[1] == whole.channels
        assert one.cause
        assert (one.cause, one.z.tobytes()) == (other.cause, other.z.tobytes())


def test_some_searches_run_on_roads_alone():
    for place in PLACES:
        missing = set(SEARCHES) - set(list_searches(place))
        assert missing == ({"difs", "go_explore"} if place in FUNCTIONS else set())


def test_causes_and_samplers_of_optuna_are_compared_on_the_drive():
    def make(name, *values) -> dict[str, Figure]:
        return {f"search.highway_drive.{name}.causes": of_seeds(values, "causes", 100)}

    ours, theirs = make("go_explore", 2, 2, 2, 2, 2), make("optuna_tpe", 4, 4, 4, 4, 4)
    worse = dict(count_cells(ours | theirs))["search.cells.worse"]
    assert (worse.value, worse.n) == (1, 1)
    assert worse.note.endswith(": highway_drive causes")
    better = dict(count_cells(ours | theirs | make("cma", 5, 5, 5, 5, 5)))["search.cells.better"]
    assert (better.value, better.n) == (1, 1)
