"""One slot of a bridge keeps the contract of a simulation, as every simulator does."""

from contextlib import closing

import pytest
from core_worlds import list_core_names

from eigenfail import plugins
from eigenfail.errors import PlannerError, SimulatorError
from eigenfail.testing.simulation import SIMULATION_CHECKS, Cruise
from eigenfail.values.disturbance import POSITION
from eigenfail.values.scene import Control, Observation, VehicleState
from eigenfail_workers.bridge.checks import BridgeSimulation
from eigenfail_workers.bridge.connection import Connection
from eigenfail_workers.bridge.episode import ObservationReader, list_injected
from eigenfail_workers.bridge.messages import SlotObservation, SlotStart

START = SlotStart(0, 0, "cut_in", {}, "idm", {}, 100, list_injected(POSITION))


@pytest.mark.parametrize("simulator", list_core_names(plugins.SIMULATORS))
@pytest.mark.parametrize("check", SIMULATION_CHECKS, ids=lambda check: check.__name__)
def test_simulations(check, simulator: str, serving) -> None:
    cut_in = plugins.load(plugins.SCENARIOS, "cut_in")
    opener = plugins.load(plugins.SIMULATORS, simulator)()
    drivers = []

    def of_test(_asked):
        return opener.open(cut_in(), cut_in.Parameters(), drivers[-1], POSITION)

    with serving(of_test) as address:
        connections = []

        def open_simulation(planner):
            drivers.append(planner)
            connections.append(Connection(address))
            return BridgeSimulation(connections[-1], START)

        check(open_simulation)
        for connection in connections:
            connection.close()


def test_a_fault_is_blamed_on_whom_the_bridge_blames(serving) -> None:
    class Broken(Cruise):
        def act(self, perception):
            raise ZeroDivisionError("on purpose")

    cut_in = plugins.load(plugins.SCENARIOS, "cut_in")
    opener = plugins.load(plugins.SIMULATORS, "point_mass")()
    with (
        serving(
            lambda _: opener.open(cut_in(), cut_in.Parameters(), Broken(), POSITION)
        ) as address,
        closing(Connection(address)) as connection,
    ):
        simulation = BridgeSimulation(connection, START)
        simulation.reset(1)
        with pytest.raises(PlannerError, match="The planner raised ZeroDivisionError: on purpose"):
            simulation.step((0.0, 0.0))


EGO, OTHER = (0.0, 0.0, 0.0, 20.0, 16.0, 2.5), (30.0, 1.0, 0.0, 12.0, 4.5, 1.8)


def test_what_a_bridge_does_not_tell_is_seen_from_outside() -> None:
    reader = ObservationReader(POSITION, 0.1)
    reader.read(SlotObservation(0, EGO, (OTHER, (90.0, *OTHER[1:]))), ())
    slower = SlotObservation(1, (2.0, 0.0, 0.0, 19.5, 16.0, 2.5), (OTHER, OTHER))
    assert reader.read(slower, (0.5, -0.25)) == Observation(
        step=1,
        ego=VehicleState(2.0, 0.0, 0.0, 19.5, 16.0, 2.5),
        others=(VehicleState(*OTHER),) * 2,
        perceived=(30.5, 0.75),
        control=Control(-5.0, 0.0),
    )


@pytest.mark.parametrize(
    ("seen", "said"),
    [
        (SlotObservation(1, None, (OTHER,)), "has no ego"),
        (SlotObservation(1, EGO, ()), "has no other vehicles"),
        (SlotObservation(2, EGO, (OTHER,)), "step 2 where step 1 is due"),
        (SlotObservation(None, EGO, (OTHER,)), "step None where step 1 is due"),
        (SlotObservation(1, EGO, (OTHER, OTHER)), "There were 1 other vehicles, and now 2"),
        (SlotObservation(fault="simulator", message="lost\x00 it"), "lost  it"),
        (SlotObservation(fault="simulator"), "blames the simulator without a word"),
    ],
)
def test_what_is_no_observation_is_the_simulators_fault(seen: SlotObservation, said: str) -> None:
    reader = ObservationReader(POSITION, 0.1)
    reader.read(SlotObservation(0, EGO, (OTHER,)), ())
    with pytest.raises(SimulatorError, match=said):
        reader.read(seen, (0.0, 0.0))
