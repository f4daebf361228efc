"""Signals that a planner reports, in requirements and importance."""

from math import inf, nan

import numpy as np
import pytest
from msgspec.structs import replace

from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.episode import EpisodeSetup, EpisodeTask, Outcome, PriorSource
from eigenfail.values.requirements import Formula
from eigenfail.worlds import world_of
from eigenfail_workers.accounts import RecordedStep, RecordingPlanner
from eigenfail_workers.engine import Engine
from eigenfail_workers.planners.rulebook.planner import Rulebook

TASKS = tuple(EpisodeTask(index, 300 + index, PriorSource()) for index in range(6))
NOISY = DisturbanceModel(scale=3.0)
SETUP = EpisodeSetup("point_mass", "cut_in", {}, "rulebook", {}, NOISY, scene_every=1)
KEEPS_TRACKS = Formula(name="keeps tracks", formula="always(planner.lost_tracks < 0.5)")
PLANS = Formula(name="plans", formula="always(planner.planned_mps2 > -3)")
SPEC = CampaignSpec(name="t", method="monte_carlo", episodes=6, simulator="point_mass")


def explain(setup: EpisodeSetup, task: EpisodeTask) -> tuple[object, list[RecordedStep]]:
    steps: list[RecordedStep] = []
    engine = Engine(setup, lambda planner: RecordingPlanner(planner, steps))
    (result,) = engine.run([task])
    return result, steps


def test_the_robustness_is_that_of_what_the_planner_reports() -> None:
    judged = replace(SETUP, requirements=(KEEPS_TRACKS, PLANS))
    lost = []
    for task in TASKS:
        result, steps = explain(judged, task)
        accounts = [step.account for step in steps]
        lost.append(max([each["lost_tracks"] for each in accounts]))
        planned_mps2 = min([0.0, *[each["planned_mps2"] for each in accounts]])
        assert result.requirements == pytest.approx((0.5 - lost[-1], planned_mps2 + 3.0))
        plain, _ = explain(SETUP, task)
        together = min(result.steps, plain.steps)
        assert np.array_equal(result.scene.vehicles[:together], plain.scene.vehicles[:together])
    assert max(lost) > 0.0


def test_a_campaign_names_the_signals_of_its_planner_alone() -> None:
    world = world_of(SPEC.simulator)
    assert world.list_own_signals(SPEC) == ("planner.lost_tracks", "planner.planned_mps2")
    named = replace(SPEC, requirements=(KEEPS_TRACKS,), importance=PLANS)
    assert world.resolve(named)[0].requirements == (KEEPS_TRACKS,)
    mistyped = Formula(formula="always(planner.lost_track < 1)")
    with pytest.raises(UnknownName, match=r"mean 'planner\.lost_tracks'"):
        world.resolve(replace(SPEC, requirements=(mistyped,)))
    with pytest.raises(UnknownName, match=r"planner\.lost_tracks"):
        world.resolve(replace(named, planner="idm"))


@pytest.mark.parametrize("names", [None, 5, "lost_tracks", ("lost_tracks", 5), ["lost_tracks"]])
def test_names_of_signals_that_are_no_tuple_of_names_are_refused(names, monkeypatch) -> None:
    monkeypatch.setattr(Rulebook, "signal_names", names)
    named = replace(SPEC, planner="rulebook", requirements=(KEEPS_TRACKS,))
    with pytest.raises(InvalidValue, match="not a tuple of names") as refused:
        world_of(SPEC.simulator).resolve(named)
    assert refused.value.field == "planner"


@pytest.mark.parametrize("value", [0, 0.25, np.float32(0.25), np.int64(0)])
def test_a_signal_is_any_finite_number(value, monkeypatch) -> None:
    monkeypatch.setattr(Rulebook, "signals", lambda _: {"lost_tracks": value})
    (result,) = Engine(replace(SETUP, requirements=(KEEPS_TRACKS,))).run(TASKS[:1])
    assert result.fault is None
    assert result.requirements == (0.5 - float(value),)


@pytest.mark.parametrize(
    "value", [nan, inf, "many", True, np.float32(inf), None, RuntimeError("no")]
)
def test_a_signal_that_is_no_number_is_the_planners_fault(value, monkeypatch) -> None:
    def signals(_planner: Rulebook) -> dict[str, object]:
        if isinstance(value, Exception):
            raise value
        return {"lost_tracks": value} if value is not None else {}

    monkeypatch.setattr(Rulebook, "signals", signals)
    (result,) = Engine(replace(SETUP, requirements=(KEEPS_TRACKS,))).run(TASKS[:1])
    assert result.outcome is Outcome.ERRORED
    assert result.fault.kind == "planner"
    assert "signals" in result.fault.message


def test_without_such_a_requirement_the_planner_is_not_asked(monkeypatch) -> None:
    def refuse(_planner: Rulebook) -> None:
        raise AssertionError

    monkeypatch.setattr(Rulebook, "signals", refuse)
    (result,) = Engine(SETUP).run(TASKS[:1])
    assert result.fault is None
