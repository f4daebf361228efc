"""A bridge explains itself as the built-in world does."""

import pytest

from eigenfail.errors import InvalidValue
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.episode import EpisodeSetup, EpisodeTask, PriorSource, episode_seed
from eigenfail.values.scene import Observation, VehicleState
from eigenfail_workers.explain import explain

BUILT_IN = EpisodeSetup("highway", "cut_in", {}, "rulebook", {}, DisturbanceModel(scale=2.0))
BRIDGED = EpisodeSetup(
    "bridge", "cut_in", {"steps": 100}, "rulebook", {}, DisturbanceModel(scale=2.0)
)
TASK = EpisodeTask(3, episode_seed(5, 3), PriorSource())


def test_the_explanation_is_that_of_the_same_world_built_in(serving, monkeypatch) -> None:
    expected = explain(BUILT_IN, TASK)
    with serving() as address:
        monkeypatch.setenv("EIGENFAIL_BRIDGE", address)
        found = explain(BRIDGED, TASK)
    assert found.result.digest() == expected.result.digest()
    assert found.steps == expected.steps
    assert len(found.steps) == found.result.steps
    assert found.steps[0].account["heeds"]
    assert len(found.steps[0].path) > 1


def test_a_planner_that_explains_nothing_has_controls_alone(serving, monkeypatch) -> None:
    with serving() as address:
        monkeypatch.setenv("EIGENFAIL_BRIDGE", address)
        found = explain(
            BRIDGED.__class__("bridge", "cut_in", {"steps": 9}, "idm", {}, DisturbanceModel()), TASK
        )
    assert [each.account for each in found.steps] == [{}] * 9
    assert [each.path for each in found.steps] == [()] * 9
    assert found.steps[0].gap_m is not None


def test_a_text_is_an_account(serving, monkeypatch, minimal) -> None:
    told = {"account": "It saw nobody.", "path": None}
    monkeypatch.setattr(minimal, "explained", lambda _simulation: told)
    with serving() as address:
        monkeypatch.setenv("EIGENFAIL_BRIDGE", address)
        found = explain(BRIDGED, TASK)
    assert {each.account["account"] for each in found.steps} == {"It saw nobody."}


def test_an_account_that_is_too_long_is_the_simulators_fault(serving, monkeypatch, minimal) -> None:
    monkeypatch.setattr(minimal, "explained", lambda _simulation: {"account": "x" * 5000})
    with serving() as address:
        monkeypatch.setenv("EIGENFAIL_BRIDGE", address)
        found = explain(BRIDGED, TASK)
    assert found.result.fault.kind == "simulator"
    assert "The account has 5003 bytes; 4096 are the most." in found.result.fault.message
    assert found.steps == ()


def test_a_process_that_knows_no_bridge_says_so(monkeypatch) -> None:
    monkeypatch.delenv("EIGENFAIL_BRIDGE", raising=False)
    with pytest.raises(InvalidValue, match="Set EIGENFAIL_BRIDGE to its address"):
        explain(BRIDGED, TASK)


def test_an_episode_that_nobody_wants_explained_carries_no_account(
    serving, on_bridge, monkeypatch, minimal
) -> None:
    monkeypatch.setattr(minimal, "explained", lambda _simulation: {"account": "x" * 5000})
    with serving() as address:
        (result,) = on_bridge(address).run([TASK])
    assert result.fault is None


class Two:
    """An ego at 20 m/s behind a car, and another car that falls back behind it."""

    class planner:  # noqa: N801 - an attribute of the simulation
        """Explains itself."""

        @staticmethod
        def explain() -> dict[str, object]:
            return {"heeds": "lead", "vehicle": "lead", "gap_m": 1.0, "closing_mps": 2.0}

    def __init__(self, _asked: dict[str, object]) -> None:
        self._step = 0

    def reset(self, _seed: int) -> Observation:
        self._step = 0
        return self._show()

    def step(self, _disturbances: tuple[float, ...]) -> Observation:
        self._step += 1
        return self._show()

    def _show(self) -> Observation:
        at_s = 0.1 * self._step
        ego = VehicleState(20.0 * at_s, 0.0, 0.0, 20.0, 5.0, 2.0)
        behind = VehicleState(-20.0 + 15.0 * at_s, 3.5, 0.0, 15.0, 5.0, 2.0)
        lead = VehicleState(60.0 + 19.0 * at_s, 0.0, 0.0, 19.0, 5.0, 2.0)
        return Observation(
            self._step, ego, (behind, lead), False, self._step == 9, ids=("behind", "lead")
        )


@pytest.mark.parametrize(("named", "vehicle"), [("lead", 2), ("behind", 1), ("unknown", None)])
def test_id_in_an_account_names_the_vehicle_of_the_truth(
    serving, monkeypatch, named, vehicle
) -> None:
    account = {**Two.planner.explain(), "vehicle": named}
    monkeypatch.setattr(Two.planner, "explain", staticmethod(lambda: account))
    with serving(Two) as address:
        monkeypatch.setenv("EIGENFAIL_BRIDGE", address)
        setup = EpisodeSetup("bridge", "cut_in", {"steps": 9}, "idm", {}, DisturbanceModel())
        found = explain(setup, TASK)
    gaps_m = {2: 55.0, 1: -25.0, None: None}
    assert found.steps[0].vehicle == vehicle
    assert found.steps[0].gap_m == gaps_m[vehicle]
