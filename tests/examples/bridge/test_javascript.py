"""The bridge in JavaScript, against its protocol and in a campaign."""

import shutil
import subprocess
from pathlib import Path

import pytest

from eigenfail.cli.specs import read_spec
from eigenfail.values.episode import EpisodeTask, PriorSource, episode_seed

FOLDER = Path(__file__).parents[3] / "examples" / "bridge" / "javascript"
LONGEST_LINES = 100


@pytest.fixture
def address(start) -> str:
    node = shutil.which("node")
    probe = [
        node or "node",
        "--input-type=module",
        "-e",
        'import "zeromq"; import "@msgpack/msgpack"',
    ]
    try:
        subprocess.run(probe, cwd=FOLDER, check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("no node, or no npm packages: `deploy/test_tools.sh` installs them")
    return start(node, FOLDER / "bridge.js").address


def test_it_is_short() -> None:
    assert len((FOLDER / "bridge.js").read_text().splitlines()) < LONGEST_LINES


def test_it_keeps_to_the_protocol(address, check_bridge) -> None:
    check_bridge(address)


def test_missed_detections_make_it_collide(address, engine) -> None:
    spec = read_spec(FOLDER / "campaign.toml")
    tasks = [EpisodeTask(i, episode_seed(1, i), PriorSource()) for i in range(100)]
    results = list(engine(spec, address).run(tasks))
    assert [each.fault for each in results] == [None] * len(tasks)
    missed = [each.noise.injected[:, 2].sum() for each in results]
    failed = [many for many, each in zip(missed, results, strict=True) if each.is_failure]
    assert 0 < len(failed) < len(tasks)
    scene = next(each.scene for each in results if each.is_failure)
    assert [border[:, 1].tolist() for border in scene.road] == [[2.0, 2.0], [-2.0, -2.0]]
    assert scene.kinds == ("unknown", "car")
