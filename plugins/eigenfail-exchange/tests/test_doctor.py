"""`eigenfail doctor` on a scenario that replays a recording."""

import json

RECORDING = """
from eigenfail_exchange.recorded_traffic.scenario import RecordedTraffic
from eigenfail_exchange.recorded_traffic.tracks import read_tracks

class Mine(RecordedTraffic):
    tracks = read_tracks("a.xml", ego="1", without={without})
"""
OBSTACLE = """<dynamicObstacle id="{name}"><shape><{shape}><length>4.5</length><width>1.8</width>
</{shape}></shape>{states}</dynamicObstacle>"""
STATE = """<{tag}><position><point><x>{x}</x><y>{y}</y></point></position><orientation><exact>0
</exact></orientation><time><exact>{n}</exact></time></{tag}>"""


def write_recording(folder, without=()):
    """A recording of an ego, a car, and a pedestrian that is a circle."""
    obstacles = []
    for name, x_m, y_m, shape in (
        ("1", 0, 0, "rectangle"),
        ("2", 40, 0, "rectangle"),
        ("3", 9, 8, "circle"),
    ):
        first, *others = (
            STATE.format(tag="initialState" if n == 0 else "state", x=x_m + 2 * n, y=y_m, n=n)
            for n in range(31)
        )
        states = f"{first}<trajectory>{''.join(others)}</trajectory>"
        obstacles.append(OBSTACLE.format(name=name, shape=shape, states=states))
    text = f'<commonRoad timeStepSize="0.1"><lanelet/>{"".join(obstacles)}</commonRoad>'
    (folder / "a.xml").write_text(text)
    (folder / f"mine_{len(without)}.py").write_text(RECORDING.format(without=list(without)))


def test_vehicles_that_a_recording_leaves_out_do_not_pass(eigenfail, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for without, code in ((), 1), (("3",), 0):
        write_recording(tmp_path, without)
        told = eigenfail("doctor", "--scenario", f"mine_{len(without)}:Mine", "--json")
        assert told.exit_code == code, told.output
        checks = json.loads(told.stdout)
        broken = [check["said"] for check in checks if check["verdict"] == "broken"]
        assert len(broken) == code
        assert all("'3': It has no rectangle" in said for said in broken)
        noted = [check["said"] for check in checks if check["verdict"] == "noted"]
        assert "lanelet (1)" in noted[0]
