"""Failure modes of both versions, as the comparison of releases matches them: told, not judged."""

import json
from xml.etree import ElementTree as ET

from eigenfail.client.releases import Releases
from eigenfail.errors import NotFound


def test_modes_of_both_versions_are_reported_and_judge_nothing(gate, eigenfail, tmp_path, store):
    written = tmp_path / "gate.xml"
    done = gate("usual", "--json", "--junit", written)
    assert done.exit_code == 0, done.output
    (matched,) = json.loads(done.stdout)["matched"]
    assert (matched["members"], matched["problem"]) == (["one", "two"], "")
    modes = matched["modes"]
    assert modes
    assert {mode["status"] for mode in modes} <= {"still there", "undecided"}
    assert all(mode["before"] == mode["now"] > 0 for mode in modes)
    table = eigenfail("release", "show", matched["campaign"], "--json")
    names = [each["name"] for each in json.loads(table.stdout)["modes"]]
    assert [mode["name"] for mode in modes] == names
    (suite,) = (
        each
        for each in ET.fromstring(written.read_bytes())
        if each.get("name") == "trio: failure modes over releases"
    )
    assert len(suite.findall("testcase/skipped[@message='not judged']")) == len(modes)
    shown = eigenfail("gate", "show", store.gates.page(1).items[0].id).stdout
    assert "over releases" in shown
    assert "reported and not judged" in " ".join(shown.split())


def test_a_baseline_without_a_version_says_why_no_mode_is_matched(eigenfail, suite):
    file = suite()
    assert eigenfail("suite", "run", file).exit_code == 0
    words = ("--planner-version", "v2", "--baseline", "trio", "--json")
    (matched,) = json.loads(eigenfail("gate", file, *words).stdout)["matched"]
    assert matched["modes"] == []
    assert matched["problem"] == "The baseline names no version of the planner."


def test_a_campaign_that_is_part_of_no_comparison_says_so_and_the_gate_goes_on(gate, monkeypatch):
    def refuse(*_):
        raise NotFound("Campaign 9 is part of no release.", "Name a newer one.")

    monkeypatch.setattr(Releases, "get", refuse)
    done = gate("usual", "--json")
    assert done.exit_code == 0
    problems = [each["problem"] for each in json.loads(done.stdout)["matched"]]
    assert len(problems) == 2
    assert all("part of no release" in each for each in problems)
