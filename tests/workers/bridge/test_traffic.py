"""Vehicles that enter and leave, and signals of a bridge's own."""

import numpy as np
import pytest
from msgspec.structs import replace

from eigenfail.errors import InvalidValue, SimulatorError, UnknownName
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.channels import Channel
from eigenfail.values.disturbance import POSITION, DisturbanceModel
from eigenfail.values.episode import EpisodeTask, Outcome, PriorSource, TrajectorySource
from eigenfail.values.requirements import Formula
from eigenfail.values.scene import Control, Observation, VehicleState
from eigenfail.worlds import world_of
from eigenfail_workers.bridge.episode import ObservationReader
from eigenfail_workers.bridge.messages import SlotObservation

STEPS, DT_S = 20, 0.1
TASK = EpisodeTask(0, 7, PriorSource())
CALM = EpisodeTask(0, 7, TrajectorySource(np.zeros((STEPS, 2), np.float32)))
WELCOME = {
    "scenarios": [{"name": "cut_in", "dt_s": DT_S, "steps": STEPS}],
    "signals": [{"name": "planned_gap_m", "unit": "m"}],
}


class Traffic:
    """A truck at 20 m/s, whom a car of 30 m/s passes and one of 10 m/s comes to meet later.

    At step 4 the second car enters, 25 m ahead; at step 8 the first one leaves.
    """

    def __init__(self, asked: dict[str, object]) -> None:
        self.steps = asked["steps"]

    def reset(self, _seed: int) -> Observation:
        self._step = 0
        return self._show()

    def step(self, disturbance: tuple[float, ...]) -> Observation:
        self._step += 1
        shown = self._show()
        return replace(shown, control=Control(0.0, 0.0), applied=Control(0.0, 0.0))

    def _show(self) -> Observation:
        at_s = self._step * DT_S
        ego = VehicleState(20.0 * at_s, 0.0, 0.0, 20.0, 10.0, 2.0)
        cars = {
            7: VehicleState(-10.0 + 30.0 * at_s, 4.0, 0.0, 30.0, 4.0, 2.0),
            3: VehicleState(33.0 + 10.0 * (at_s - 0.4), 0.0, 0.0, 10.0, 5.0, 2.0),
        }
        present = [7] if self._step < 4 else [3, 7] if self._step < 8 else [3]
        gap_m = cars[3].x_m - ego.x_m - 7.5
        collided = 3 in present and gap_m <= 0.0
        return Observation(
            self._step,
            ego,
            tuple(cars[name] for name in present),
            collided,
            collided or self._step == self.steps,
            ids=tuple(present),
            signals={"planned_gap_m": 30.0 - self._step},
        )


def run(serving, on_bridge, task: EpisodeTask = CALM, steps: int = STEPS, **changes):
    with serving(Traffic, **WELCOME) as address:
        engine = on_bridge(address, scenario_parameters={"steps": steps}, scene_every=1, **changes)
        (result,) = engine.run([task])
    return result


def test_each_vehicle_keeps_its_place_in_the_scene(serving, on_bridge) -> None:
    result = run(serving, on_bridge, steps=12)
    assert result.fault is None
    vehicles = result.scene.vehicles
    there = ~np.isnan(vehicles[:, :, 0])
    assert there[:, 0].all()
    assert np.flatnonzero(there[:, 1]).tolist() == [0, 1, 2, 3, 4, 5, 6, 7]
    assert np.flatnonzero(there[:, 2]).tolist() == [4, 5, 6, 7, 8, 9, 10, 11, 12]
    assert result.scene.sizes.tolist() == [[10.0, 2.0], [4.0, 2.0], [5.0, 2.0]]
    assert vehicles[4, 2, 0] == pytest.approx(33.0)
    assert vehicles[7, 1, 0] == pytest.approx(11.0)


def test_measures_are_those_of_the_vehicles_that_are_there(serving, on_bridge) -> None:
    # The first car passes 2 m aside. The second one is 17.5 m ahead of the front when it enters,
    # and 10 m/s slower: 9.5 m ahead after 8 more steps, with 9.5 m / 10 m/s to go.
    result = run(serving, on_bridge, steps=12)
    assert result.outcome is Outcome.SAFE
    assert result.measures.robustness_m == pytest.approx(2.0)
    assert result.measures.min_ttc_s == pytest.approx(0.95)
    assert result.measures.ttc_violated_s == pytest.approx(0.7)  # 14.5 m: 1.45 s


def test_a_collision_is_with_the_vehicle_that_was_struck(serving, on_bridge) -> None:
    # 17.5 m at 10 m/s are 1.75 s after step 4: over at step 22, beyond this horizon; so longer.
    with serving(
        Traffic, **WELCOME | {"scenarios": [{"name": "cut_in", "dt_s": DT_S, "steps": 40}]}
    ) as address:
        engine = on_bridge(address, scenario_parameters={"steps": 40}, scene_every=1)
        task = EpisodeTask(0, 7, TrajectorySource(np.zeros((40, 2), np.float32)))
        (result,) = engine.run([task])
    assert result.outcome is Outcome.COLLISION
    assert result.steps == 22
    assert result.measures.severity == pytest.approx(100.0)
    assert result.measures.ttc_violated_s == pytest.approx(0.7)


def test_replays_are_the_episode_bit_for_bit(serving, on_bridge) -> None:
    first = run(serving, on_bridge, TASK)
    again = EpisodeTask(0, first.seed, TrajectorySource(first.noise.z))
    assert run(serving, on_bridge, again).digest() == first.digest()


def test_the_sigma_of_a_vehicle_that_is_not_there_is_that_of_no_distance(
    serving, on_bridge
) -> None:
    channel = Channel("vehicle_2.longitudinal", 1.0, 0.1)
    model = DisturbanceModel(channels=(channel,))
    with serving(Traffic, **WELCOME, channels=["every.longitudinal"]) as address:
        engine = on_bridge(address, scenario_parameters={"steps": 12}, disturbance=model)
        task = EpisodeTask(0, 7, TrajectorySource(np.zeros((12, 1), np.float32)))
        (result,) = engine.run([task])
    sigma = result.noise.sigma[:, 0]
    assert sigma[:4].tolist() == [1.0] * 4
    # It is the second one that was seen, 25 m ahead of the truck's centre when it enters.
    assert sigma[4] == pytest.approx(1.0 + 0.1 * 25.0)


EGO, CAR, VAN = (
    (0.0, 0.0, 0.0, 20.0, 10.0, 2.0),
    (30.0, 0.0, 0.0, 10.0, 4.0, 2.0),
    (60.0, 0.0, 0.0, 10.0, 6.0, 2.0),
)


@pytest.mark.parametrize(
    ("after", "said"),
    [
        (SlotObservation(1, EGO, (CAR, VAN), ids=(1, 1)), "have the ids"),
        (SlotObservation(1, EGO, (CAR, VAN), ids=(1,)), "have the ids"),
        (SlotObservation(1, EGO, (VAN,), ids=("a",)), "'a' had another footprint before"),
        (SlotObservation(1, EGO, (CAR,)), "have `ids`, and some do not"),
        (SlotObservation(1, EGO, (), ids=()), "has no other vehicles"),
    ],
)
def test_ids_that_are_none_are_the_simulators_fault(after: SlotObservation, said: str) -> None:
    reader = ObservationReader(POSITION, DT_S)
    reader.read(SlotObservation(0, EGO, (CAR,), ids=("a",)), ())
    with pytest.raises(SimulatorError, match=said):
        reader.read(after, (0.0, 0.0))


def test_an_episode_has_a_bounded_number_of_vehicles() -> None:
    reader = ObservationReader(POSITION, DT_S)
    reader.read(SlotObservation(0, EGO, (CAR,), ids=(0,)), ())
    for step in range(1, 256):
        reader.read(SlotObservation(step, EGO, (CAR,), ids=(step,)), (0.0, 0.0))
    with pytest.raises(SimulatorError, match="more than 256 other vehicles"):
        reader.read(SlotObservation(256, EGO, (CAR,), ids=(256,)), (0.0, 0.0))


def make_spec(formula: str) -> CampaignSpec:
    return CampaignSpec(
        name="x",
        method="monte_carlo",
        episodes=5,
        simulator="bridge",
        scenario_parameters={"steps": STEPS},
        requirements=(Formula(formula=formula),),
    )


def test_a_requirement_may_name_a_signal_of_the_bridge(serving, on_bridge) -> None:
    formula = "always (bridge.planned_gap_m > 22)"
    spec = make_spec(formula)
    assert world_of("bridge").resolve(spec)[0].requirements == spec.requirements
    result = run(serving, on_bridge, steps=12, requirements=spec.requirements)
    # It is 30 m at the start, and 1 m less after each step: 18 m at the last one.
    assert result.fault is None
    assert result.requirements == pytest.approx((-4.0,))
    assert result.outcome is Outcome.VIOLATION


def test_a_signal_that_the_bridge_does_not_report_is_named(serving, on_bridge) -> None:
    requirements = (Formula(formula="always (bridge.planed_gap_m > 22)"),)
    with serving(Traffic, **WELCOME) as address:
        engine = on_bridge(address, scenario_parameters={"steps": STEPS}, requirements=requirements)
        (result,) = engine.run([CALM])
    assert result.fault.kind == "input"
    assert "Did you mean 'bridge.planned_gap_m'?" in result.fault.message
    assert engine.declined


def test_a_signal_that_is_missing_in_one_step_is_the_simulators_fault(
    serving, on_bridge, monkeypatch
) -> None:
    show = Traffic._show
    monkeypatch.setattr(
        Traffic,
        "_show",
        lambda self: replace(show(self), signals=None if self._step == 3 else {"planned_gap_m": 1}),
    )
    requirements = (Formula(formula="always (bridge.planned_gap_m > 0)"),)
    result = run(serving, on_bridge, requirements=requirements)
    assert result.fault.kind == "simulator"
    assert "After step 3 the simulator does not tell the signal" in result.fault.message


def test_other_worlds_have_no_signals_of_a_bridge() -> None:
    spec = replace(
        make_spec("always (bridge.gap > 1)"), simulator="highway", scenario_parameters={}
    )
    with pytest.raises(UnknownName, match=r"bridge\.gap"):
        world_of("highway").resolve(spec)
    with pytest.raises(InvalidValue, match=r"requirements\[0\]\.formula"):
        world_of("bridge").resolve(make_spec("always (bridge.gap >"))
