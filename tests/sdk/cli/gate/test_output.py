"""What people and pipelines see of a gate."""

import re
from xml.etree import ElementTree as ET


def test_people_see_what_is_new_and_what_it_means(gate):
    done = gate("worse")
    assert "The gate of trio @ v2 against v1 is closed. Known failures, " in done.stdout
    assert re.search(r"one +medoid 1, 1/\d+ +still failing +eigenfail episode replay", done.stdout)
    assert re.search(r"one +episode \d+ +new +eigenfail episode replay", done.stdout)
    assert "over all versions: analyse the new campaigns, then: eigenfail release" in done.stdout
    assert "\x1b" not in done.stdout
    assert "can be a baseline" not in done.stdout


def test_junit_is_written_whole(gate, tmp_path):
    file = tmp_path / "gate.xml"
    assert gate("worse", "--junit", file).exit_code == 1
    root = ET.fromstring(file.read_bytes())
    assert int(root.get("failures")) > 0
    names = ["trio: one", "trio: two"]
    assert [suite.get("name") for suite in root] == names
    assert sorted(path.name for path in tmp_path.glob("*.xml*")) == ["gate.xml"]
