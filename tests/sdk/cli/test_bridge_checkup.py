"""`eigenfail doctor --bridge`: a bridge is held against its protocol, over the wire."""

import json
import socketserver
import subprocess
import sys
from pathlib import Path
from threading import Thread

import pytest
from msgspec.msgpack import decode

from eigenfail.bridges import EPISODE_VARIABLE
from eigenfail.cli.specs import check_local_bridge, read_spec

BRIDGES = Path(__file__).parents[3] / "examples" / "bridge"
LOOK = "Look at its own log; `eigenfail doctor --bridge` tries it."
CARELESS = """
import sys
sys.path.insert(0, sys.argv[2])
import minimal

class Careless(minimal.Bridge):
    # It takes every seed for another, and lets a step after the end be one more.
    runs = 0

    def reset(self, held, asked):
        Careless.runs += 1
        return super().reset(held, asked) | {"ego": [Careless.runs, 0, 0, 20, 16, 2]}

    def step(self, held, asked):
        shown = super().step(held, asked)
        shown.pop("fault", None)
        return {"step": 1, "ego": [0, 0, 0, 1, 1, 1], "others": [[9, 0, 0, 1, 1, 1]]} | shown

minimal.serve(sys.argv[1], Careless(minimal.welcome(), minimal.built_in))
"""


GOES_WRONG = """
import os, sys
sys.path.insert(0, sys.argv[2])
import minimal

welcome = minimal.welcome(4)
welcome["scenarios"], welcome["planners"] = welcome["scenarios"][:1], welcome["planners"][:1]

{how}

minimal.serve(sys.argv[1], minimal.Bridge(welcome, minimal.built_in))
"""
DIES = """
minimal.Bridge.step = lambda *_: os._exit(1)
"""
GARBLES = """
packed = minimal.encode
minimal.encode = lambda said: bytes([0xC1]) if said["type"] == "observations" else packed(said)
"""
IS_SLOW = """
welcome["scenarios"][0]["dt_s"] = 1e-9
"""


@pytest.fixture
def start(tmp_path):
    """Starts a bridge; where it listens."""
    started = []

    def run(*command: object) -> str:
        address = f"ipc://{tmp_path}/b{len(started)}"
        words = [sys.executable, *map(str, command[:2]), address, *map(str, command[2:])]
        started.append(subprocess.Popen(words))
        return address

    yield run
    for program in started:
        program.kill()
        program.wait()


def verdicts(told) -> dict[tuple[str, str], tuple[str, str]]:
    checks = json.loads(told.stdout)
    return {(each["plugin"], each["check"]): (each["verdict"], each["said"]) for each in checks}


def test_the_reference_bridge_does_all_that_it_should(eigenfail, start) -> None:
    address = start(BRIDGES / "minimal.py")
    told = eigenfail("doctor", "--bridge", address, "--json")
    assert told.exit_code == 0, told.output
    found = verdicts(told)
    assert {verdict for verdict, _ in found.values()} == {"passed"}
    assert found["cut_in", "scenario"][1].startswith("steps = 100, dt_s = 0.1, distance_m = 58.0")
    assert ("cut_in, idm", "keeps slots apart") in found
    assert ("merge_in, idm", "counts steps") in found
    assert ("cut_in, idm", "disturbs each channel") in found
    assert "delay, ego.heading" in found[address, "channels"][1]


def test_what_a_bridge_does_wrong_is_named(eigenfail, start) -> None:
    address = start("-c", CARELESS, BRIDGES)
    told = eigenfail("doctor", "--bridge", address, "--json")
    assert told.exit_code == 3
    found = verdicts(told)
    assert found["cut_in, idm", "repeats itself"] == (
        "broken",
        "The second episode differs from the first.",
    )
    assert found["cut_in, idm", "refuses what is over"][0] == "broken"
    assert found["cut_in, idm", "starts at step zero"][0] == "passed"


def test_a_bridge_that_disconnects_is_not_asked_for_ever(eigenfail, start, monkeypatch) -> None:
    monkeypatch.setenv(EPISODE_VARIABLE, "30")  # it is waited for by that
    told = eigenfail(
        "doctor", "--bridge", start("-c", GOES_WRONG.format(how=DIES), BRIDGES), "--json"
    )
    assert told.exit_code == 3
    checks = list(verdicts(told).values())
    assert [verdict for verdict, _ in checks[:6]] == ["passed"] * 5 + ["broken"]
    assert "went away" in checks[5][1]
    assert {verdict for verdict, _ in checks[6:]} == {"skipped"}
    assert len(checks) > 10


def test_garbage_is_named_as_such(eigenfail, start) -> None:
    told = eigenfail(
        "doctor", "--bridge", start("-c", GOES_WRONG.format(how=GARBLES), BRIDGES), "--json"
    )
    assert told.exit_code == 3
    found = verdicts(told)
    for check in ("keeps pace", "starts at step zero", "refuses unknown names"):
        verdict, said = found["cut_in, idm", check]
        assert verdict == "broken"
        assert "The bridge's answer cannot be read" in said


def test_a_bridge_slower_than_real_time_is_told_and_does_what_it_should(eigenfail, start) -> None:
    told = eigenfail(
        "doctor", "--bridge", start("-c", GOES_WRONG.format(how=IS_SLOW), BRIDGES), "--json"
    )
    assert told.exit_code == 0, told.output
    found = verdicts(told)
    verdict, said = found.pop(("cut_in, idm", "keeps pace"))
    assert verdict == "slow"
    assert "× real time; " in said
    assert " ms for 4 side by side. Slower than real time" in said
    assert {verdict for verdict, _ in found.values()} == {"passed"}


class HangsUp(socketserver.BaseRequestHandler):
    """Whatever it is, it is no bridge."""


def test_where_no_bridge_answers_nothing_else_is_asked(eigenfail) -> None:
    with socketserver.TCPServer(("127.0.0.1", 0), HangsUp) as server:
        thread = Thread(target=server.serve_forever)
        thread.start()
        address = f"tcp://127.0.0.1:{server.server_address[1]}"
        told = eigenfail("doctor", "--bridge", address, "--json")
        server.shutdown()
        thread.join()
    assert told.exit_code == 3
    (_, hello), *others = verdicts(told).items()
    assert hello == ("broken", f"The bridge at {address} went away. {LOOK}")
    assert {verdict for _, (verdict, _) in others} == {"skipped"}


def test_a_bridge_elsewhere_is_wrong_usage(eigenfail) -> None:
    told = eigenfail("doctor", "--bridge", "tcp://192.0.2.1:9000")
    assert told.exit_code == 2
    assert "EIGENFAIL_TRUST_NETWORK" in told.output


CAMPAIGN = """
name = "c"
method = "monte_carlo"
episodes = 10
simulator = "bridge"
scenario = "cut_in"
planner = "idm"
scenario_parameters = {{ steps = 20, {parameter} }}
"""


HELD = {
    "distance_m = 58.0": (0, "passed", "It is safe after 20 steps."),
    "distance = 58.0": (3, "broken", "Did you mean 'distance_m'?"),
    "distance_m = -1.0": (3, "broken", "distance_m"),
}


@pytest.mark.parametrize("parameter", HELD)
def test_a_campaign_is_held_against_the_bridge(parameter, eigenfail, start, tmp_path) -> None:
    code, verdict, said = HELD[parameter]
    file = tmp_path / "c.toml"
    file.write_text(CAMPAIGN.format(parameter=parameter))
    address = start(BRIDGES / "minimal.py")
    told = eigenfail("doctor", "--bridge", address, "--campaign", str(file), "--json")
    assert told.exit_code == code, told.output
    found = verdicts(told)["cut_in, idm", "runs an episode of the campaign"]
    assert found[0] == verdict
    assert said in found[1]


def test_a_campaign_without_a_bridge_is_wrong_usage(eigenfail, tmp_path) -> None:
    file = tmp_path / "c.toml"
    file.write_text('name = "c"\nmethod = "monte_carlo"\nepisodes = 10\n')
    told = eigenfail("doctor", "--campaign", str(file))
    assert (told.exit_code, "Give its address with --bridge" in told.output) == (2, True)
    told = eigenfail("doctor", "--bridge", "ipc:///tmp/none", "--campaign", str(file))
    assert (told.exit_code, 'simulator = "bridge"' in told.output) == (2, True)


def test_the_messages_of_the_protocol_are_written_without_a_bridge(eigenfail, tmp_path) -> None:
    folder = tmp_path / "golden"
    told = eigenfail("doctor", "--golden", str(folder), "--json")
    assert told.exit_code == 0, told.output
    names = json.loads(told.stdout)
    assert {"hello", "welcome", "step", "observations_after_step"} <= set(names)
    assert {file.name for file in folder.iterdir()} == {
        f"{name}.{kind}" for name in names for kind in ("msgpack", "json")
    }
    for name in names:
        text = json.loads((folder / f"{name}.json").read_text())
        assert decode((folder / f"{name}.msgpack").read_bytes()) == text
    assert eigenfail("doctor", "--golden", str(folder), "--bridge", "ipc:///tmp/b").exit_code == 2


def test_a_run_that_the_bridge_cannot_serve_ends_before_a_service_is_started(
    eigenfail, start, tmp_path, monkeypatch
) -> None:
    file, data = tmp_path / "c.toml", tmp_path / "data"
    file.write_text(CAMPAIGN.format(parameter="distance = 58.0"))
    monkeypatch.setenv("EIGENFAIL_BRIDGE", start(BRIDGES / "minimal.py"))
    for seeds in ((), ("--seeds", "2")):
        told = eigenfail("run", str(file), "--data", str(data), *seeds)
        assert told.exit_code == 2, told.output
        assert "scenario_parameters: 'distance' is not known" in told.output
        assert "Did you mean 'distance_m'?" in told.output
    assert not data.exists()


def test_a_bridge_that_does_not_answer_refuses_no_campaign(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("EIGENFAIL_BRIDGE", f"ipc://{tmp_path}/none")
    file = tmp_path / "c.toml"
    file.write_text(CAMPAIGN.format(parameter="distance = 58.0"))
    check_local_bridge([read_spec(file)])
