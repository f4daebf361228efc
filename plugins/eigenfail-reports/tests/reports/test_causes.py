"""What a report says of proofs and minimal failures, once there are any."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.scene import Scene
from eigenfail_reports.material import Material, gather_material
from eigenfail_reports.page import ReportPart
from eigenfail_reports.report import costs, evidence
from eigenfail_services.analysis.footprints import find_struck
from eigenfail_services.campaigns.analysis_jobs import run_analysis
from eigenfail_services.campaigns.minimal_failures import find_minimal_failure
from eigenfail_services.campaigns.proofs import launch_replays, summarise_proof
from eigenfail_services.store.store import Store, open_store

VARIED = {"scenario_parameters": {"distance_m": {"uniform": [52.0, 70.0]}}, "episodes": 80}


@pytest.fixture(scope="module")
def store(run: Callable[..., int], finish: Callable[..., int]) -> Store:
    """Campaign 1 varies its scenario and is analysed and proven, 2 shrinks a failure of it."""
    store = open_store("memory://")
    run(store, name="Varied", **VARIED)
    failure = next(store.episodes.failure_portions(1)).indices[0]
    settings = {"campaign": 1, "episode": failure}
    run(store, name="Minimal", method="minimal", settings=settings, episodes=120)
    analysis = store.analyses.create(1, AnalysisSettings(clusters=2, bootstrap=0))
    run_analysis(store, analysis.id)
    for scenario in launch_replays(store, store.analyses.get(analysis.id), ({},)).scenarios:
        finish(store, scenario.campaign)
    return store


@pytest.fixture(scope="module")
def material(store: Store) -> Material:
    return gather_material(store, (1, 2))


def rows(part: ReportPart, name: str) -> list[dict[str, Any]]:
    (table,) = [each for each in part.section.tables if each.name == name]
    names = [column.name for column in table.columns]
    return [dict(zip(names, row, strict=True)) for row in table.rows]


def test_the_proof_is_that_of_the_analysis(material: Material, store: Store) -> None:
    part = evidence.make_proof(material)
    assert part is not None
    proven = summarise_proof(store, store.analyses.get(1))
    scenarios = rows(part, "proof")
    assert {row["scenario"] for row in scenarios} == {each.words for each in proven.scenarios}
    assert all(each.words.startswith("the same (drawn: distance_m = ") for each in proven.scenarios)
    assert len(scenarios) == 2 * len(proven.scenarios)
    for what, overall in (("eigenfailure", proven.eigenfailures), ("medoid", proven.medoids)):
        ours = [row for row in scenarios if row["what"].startswith(what)]
        assert overall.rate is not None
        assert sum(row["reproduced"] for row in ours) == overall.rate.k
        assert sum(row["tried"] for row in ours) == overall.rate.n == 2
    assert len(rows(part, "replays")) == 4
    assert proven.eigenfailures.rate is not None
    told = f"of its eigenfailures {proven.eigenfailures.rate.k} of 2 failed again"
    assert told in " ".join(part.section.words)


def test_the_minimal_failure_is_the_one_that_was_found(material: Material, store: Store) -> None:
    part = costs.make_minimal(material)
    assert part is not None
    found = find_minimal_failure(store, store.campaigns.get(2))
    (row,) = rows(part, "minimal")
    assert (row["campaign"], row["episode"]) == (2, found.index)
    assert (row["needed"], row["injected"]) == (found.needed, found.injected)
    assert row["needed"] < row["injected"]
    assert found.words in " ".join(part.section.words)


ABSENT = (np.nan,) * 4


@pytest.mark.parametrize(
    ("others", "struck"),
    [
        # The first car is alongside, 1 m apart; the second one runs into the truck from behind.
        ([(2.0, 3.25, 0.0, 20.0), (-10.0, 0.0, 0.0, 20.0)], 2),
        ([ABSENT, (2.0, 3.25, 0.0, 20.0), (10.0, 0.0, 0.0, 10.0)], 3),
        # Both overlap it.
        ([(9.0, 0.0, 0.0, 20.0), (-7.0, 0.0, 0.0, 20.0)], 2),
        # None does, as where a bridge has other footprints.
        ([(14.0, 0.0, 0.0, 20.0), (6.0, 6.0, 0.0, 20.0)], 1),
    ],
)
def test_the_vehicle_struck_is_the_one_with_the_nearest_footprint(others, struck) -> None:
    vehicles = np.array([[(0.0, 0.0, 0.0, 20.0), *others]], np.float32)
    sizes = np.array([(16.0, 2.5), *[(5.0, 2.0)] * len(others)], np.float32)
    none = np.zeros((0, 2), np.float32)
    assert find_struck(Scene(0.1, vehicles, sizes, none, none)) == struck


def test_nothing_is_said_where_there_is_nothing(run: Callable[..., int]) -> None:
    store = open_store("memory://")
    run(store, name="Plain", first=3)
    material = gather_material(store, (1,))
    for make in (evidence.make_proof, costs.make_minimal):
        assert make(material) is None
