"""Undisturbed, the truck drives as SUMO drives it by itself."""

import json
import subprocess
import sys
from pathlib import Path
from xml.etree.ElementTree import fromstring

import pytest

BRIDGES = Path(__file__).parents[3] / "examples" / "bridge"
DRIVE = """
import json, sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
import sumo_world as sumo

ALL_THAT_SUMO_HEEDS = 31
given = sumo.PARAMETERS | sumo.SETTINGS
world = sumo.BrakingLead(Path(sys.argv[2]), sys.argv[3], given, sumo.STEPS)

def course():
    seen = [world.reset(0)]
    while not seen[-1].ended:
        seen.append(world.step((0.0, 0.0)))
    return [[each.ego.x_m, each.ego.speed_mps, each.others[0].x_m] for each in seen]

through_us = course()
sumo.WITHIN_ACCELERATION = ALL_THAT_SUMO_HEEDS
sumo.vehicle.setSpeed = lambda *_: None
print(json.dumps([through_us, course()]))
"""


WRITE = """
import json, sys
sys.path.insert(0, sys.argv[1])
import sumo_world as sumo

given = sumo.PARAMETERS | sumo.SETTINGS | json.loads(sys.argv[2])
print(sumo.traffic("ACC", given))
"""


def test_what_a_campaign_sets_stays_an_attribute(monkeypatch) -> None:
    monkeypatch.setenv("LIBSUMO_AS_TRACI", "quiet")
    breaks_out = '1" sigma="1"/><vehicle id="third" x="&amp;'
    words = [sys.executable, "-c", WRITE, str(BRIDGES), json.dumps({"tau_s": breaks_out})]
    told = subprocess.run(words, capture_output=True, text=True, check=True)
    routes = fromstring(told.stdout)
    assert [each.get("tau") for each in routes.iter("vType")] == [breaks_out, None]
    assert [each.get("id") for each in routes.iter("vehicle")] == ["lead", "ego"]


@pytest.mark.parametrize("model", ["ACC", "IDM", "Krauss"])
def test_undisturbed_it_is_sumo_alone(tmp_path, monkeypatch, model) -> None:
    monkeypatch.setenv("LIBSUMO_AS_TRACI", "quiet")
    words = [sys.executable, "-c", DRIVE, str(BRIDGES), str(tmp_path), model]
    told = subprocess.run(words, capture_output=True, text=True, check=True)
    through_us, alone = json.loads(told.stdout)
    assert len(through_us) == len(alone) == 121
    for ours, its in zip(through_us, alone, strict=True):
        assert ours == pytest.approx(its, abs=1e-6)
    assert min(speed for _, speed, _ in alone) < 1.0
