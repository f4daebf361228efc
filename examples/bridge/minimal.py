"""A bridge: a process that holds simulator and planner. docs/bridge.md has the protocol.

python minimal.py tcp://127.0.0.1:9000
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from math import isnan
from time import monotonic
from typing import Any

import zmq
from msgspec.msgpack import decode, encode
from msgspec.structs import asdict, astuple

from eigenfail import plugins
from eigenfail.contracts import Simulation
from eigenfail.errors import InputError, UnknownName
from eigenfail.settings import read_settings
from eigenfail.values.channels import ALL_CHANNELS, EVERY, VEHICLE, Channel, split_name
from eigenfail.values.scene import Observation

Open = Callable[[dict[str, Any]], Simulation]
Act = Callable[[dict[int, Any], dict[str, Any]], dict[str, Any]]
PROTOCOL = 2
MOST_SESSIONS = 64
SILENT_S = 60.0


@dataclass
class Session:
    """Of a worker: what is in its slots, in which of them an episode runs, when it asked last."""

    held: dict[int, tuple[dict[str, Any], Simulation]] = field(default_factory=dict)
    running: set[int] = field(default_factory=set)
    asked_s: float = field(default_factory=monotonic)

    def may_go(self) -> bool:
        """Nobody says goodbye for a worker that was killed, but it is silent."""
        return not self.running or monotonic() - self.asked_s > SILENT_S


class Bridge:
    """Answers requests. `open_simulation` makes what one slot needs, from the map of a reset."""

    def __init__(self, welcome: dict[str, Any], open_simulation: Open) -> None:
        self.welcome, self.open = welcome, open_simulation
        self.sessions: dict[str, Session] = {}

    def answer(self, request: dict[str, Any]) -> dict[str, Any]:
        """One message for one message."""
        if request["type"] == "hello":
            return self.let_in(request["protocol"], request["session"])
        if request["session"] not in self.sessions:
            told = {"fault": "simulator", "message": "I do not know this session.", "lost": True}
            return {"type": "error", "id": request["id"], **told}
        session = self.sessions.pop(request["session"])
        if request["type"] == "close":
            return {"type": "closed", "id": request["id"]}
        act = {"reset": self.reset, "step": self.step}[request["type"]]
        self.sessions[request["session"]], session.asked_s = session, monotonic()
        slots = [self.acted(act, session, each) for each in request["slots"]]
        return {"type": "observations", "id": request["id"], "slots": slots}

    def let_in(self, protocol: int, name: str) -> dict[str, Any]:
        """Begin a session; if there is no room, one ends that is idle, idle for longest."""
        if protocol != PROTOCOL:
            return {"type": "refusal", "reason": f"I speak protocol {PROTOCOL}."}
        self.sessions.pop(name, None)
        if len(self.sessions) >= MOST_SESSIONS:
            left = [each for each, session in self.sessions.items() if session.may_go()]
            if not left:
                return {"type": "refusal", "reason": "All sessions are in use.", "full": True}
            del self.sessions[min(left, key=lambda each: len(self.sessions[each].running) > 0)]
        self.sessions[name] = Session()
        return self.welcome

    def acted(self, act: Act, session: Session, asked: dict[str, Any]) -> dict[str, Any]:
        """What came of it in one slot, and whether an episode runs there now."""
        slot = asked["slot"]
        seen = act(session.held, asked)
        over = "fault" in seen or seen.get("ended", False)
        (session.running.discard if over else session.running.add)(slot)
        return seen

    def reset(self, held: dict[int, Any], asked: dict[str, Any]) -> dict[str, Any]:
        """Begin an episode; the simulation of the last one serves again if it is the same."""
        slot, seed = asked.pop("slot"), asked.pop("seed")
        try:
            if slot not in held or held[slot][0] != asked:
                held[slot] = asked, self.open(asked)
            simulation = held[slot][1]
            return shown(simulation.reset(int(seed))) | scenery(simulation)
        except Exception as error:  # noqa: BLE001 - whatever it is, its slot alone fails
            held.pop(slot, None)
            return fault(error)

    def step(self, held: dict[int, Any], asked: dict[str, Any]) -> dict[str, Any]:
        """Move one slot by one step."""
        try:
            begun, simulation = held[asked["slot"]]
            disturbance = tuple(asked["disturbances"][each["name"]] for each in begun["channels"])
            seen = shown(simulation.step(disturbance))
            return seen | (explained(simulation) if begun.get("explain") else {})
        except Exception as error:  # noqa: BLE001 - the same
            held.pop(asked["slot"], None)
            return fault(error)


def explained(simulation: Any) -> dict[str, Any]:
    """What the planner says of the step just taken, if there is one that says something."""
    planner = getattr(simulation, "planner", None)
    account = getattr(planner, "explain", dict)()
    path = getattr(planner, "path", tuple)()
    return {"account": dict(account), "path": [[float(x), float(y)] for x, y in path]}


def scenery(simulation: Any) -> dict[str, Any]:
    """The borders of the lanes, if the simulation shows them."""
    borders = getattr(simulation, "road", None)
    return {"road": borders()} if borders else {}


def shown(seen: Observation) -> dict[str, Any]:
    """An observation as a map."""
    missed = seen.perceived is None or isnan(seen.perceived[0])
    optional = {"ids": seen.ids, "signals": seen.signals}
    told = {key: value for key, value in optional.items() if value is not None}
    return told | {
        "step": seen.step,
        "ego": astuple(seen.ego),
        "others": [astuple(other) for other in seen.others],
        "collided": seen.collided,
        "ended": seen.ended,
        "perceived": None if missed else seen.perceived,
        "control": astuple(seen.control) if seen.control else None,
        "applied": astuple(seen.applied) if seen.applied else None,
        "off_road": seen.off_road,
    }


def fault(error: Exception) -> dict[str, Any]:
    """Whose fault it was: errors of eigenfail say so; all others are the simulator's."""
    kind = "input" if isinstance(error, InputError) else getattr(error, "kind", "simulator")
    return {"fault": kind, "message": str(error) or type(error).__name__}


def serve(address: str, bridge: Bridge) -> None:
    """Answer for ever."""
    socket = zmq.Context.instance().socket(zmq.REP)
    socket.bind(address)
    while True:
        socket.send(encode(answered(bridge, socket.recv())))


def answered(bridge: Bridge, data: bytes) -> dict[str, Any]:
    """The answer to a message, also to one that makes no sense: it ends its episodes alone."""
    request: Any = None
    try:
        request = decode(data)
        return bridge.answer(request)
    except Exception as error:  # noqa: BLE001 - whatever it is, the others go on
        number = request.get("id") if isinstance(request, dict) else None
        return {"type": "error", "id": number or 0, **fault(error)}


class Driven:
    """A simulation, with the planner that drives in it."""

    def __init__(self, simulation: Simulation, planner: Any) -> None:
        self.planner = planner
        self.reset, self.step = simulation.reset, simulation.step


def built_in(asked: dict[str, Any]) -> Driven:
    """highway-env with the scenario and the planner of that name; yours goes here."""
    scenario = plugins.load(plugins.SCENARIOS, asked["scenario"])
    planner = plugins.load(plugins.PLANNERS, asked["planner"])
    parameters = read_settings(scenario.Parameters, asked["parameters"], "parameters")
    settings = read_settings(planner.Settings, asked["settings"], "settings")
    driver = planner(settings)
    simulator = plugins.load(plugins.SIMULATORS, "highway")()
    simulation: Any = simulator.open(scenario(), parameters, driver, read_channels(asked))
    simulation.steps = asked["steps"]
    return Driven(simulation, driver)


def read_channels(asked: dict[str, Any]) -> tuple[Channel, ...]:
    """Those that a reset names."""
    for channel in asked["channels"]:
        target, quantity = split_name(channel["name"])
        offered = f"{EVERY}.{quantity}" if target.startswith(VEHICLE) else channel["name"]
        if offered not in ALL_CHANNELS:
            raise UnknownName("channels", channel["name"], ALL_CHANNELS)
    return tuple(Channel(**channel) for channel in asked["channels"])


def told(scenario: str) -> dict[str, Any]:
    """What a worker is told of a scenario."""
    plugin = plugins.load(plugins.SCENARIOS, scenario)
    situation = plugin()(plugin.Parameters(), 0)
    defaults = asdict(plugin.Parameters())
    dt_s, steps = situation.mission.dt_s, situation.steps
    return {"name": scenario, "dt_s": dt_s, "steps": steps, "parameters": defaults}


def of_planner(planner: str) -> dict[str, Any]:
    """What a worker is told of a planner."""
    defaults = asdict(plugins.load(plugins.PLANNERS, planner).Settings())
    plain = {name: value for name, value in defaults.items() if isinstance(value, int | float)}
    return {"name": planner, "settings": plain}


def welcome(slots: int = 32) -> dict[str, Any]:
    """What this bridge is."""
    return {
        "type": "welcome",
        "protocol": PROTOCOL,
        "name": "minimal",
        "version": "1",
        "slots": slots,
        "scenarios": [told(name) for name in ("cut_in", "lead_brake", "merge_in")],
        "planners": [of_planner(name) for name in ("idm", "rulebook")],
        "channels": sorted(ALL_CHANNELS),
    }


if __name__ == "__main__":
    serve(sys.argv[1], Bridge(welcome(), built_in))
