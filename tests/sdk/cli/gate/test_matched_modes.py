"""Failure modes of both versions, as the comparison of releases matches them: told, not judged."""

import json
from xml.etree import ElementTree as ET

import pytest

from eigenfail.cli import gate_runs
from eigenfail.client.versions import Releases
from eigenfail.errors import NotFound, ServiceBusy


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


ERRORS = (
    NotFound("Campaign 9 is part of no release.", "Name a newer one."),
    ServiceBusy("Too many comparisons are made.", "Try again later."),
)


def find_problems(done):
    assert done.exit_code == 0, done.output
    return [each["problem"] for each in json.loads(done.stdout)["matched"]]


@pytest.mark.parametrize("error", ERRORS)
def test_a_gate_goes_on_where_releases_are_not_compared_and_says_why(gate, monkeypatch, error):
    def refuse(*_):
        raise error

    monkeypatch.setattr(Releases, "get", refuse)
    assert find_problems(gate("usual", "--json")) == [str(error)] * 2


def test_a_gate_goes_on_where_the_new_version_is_not_analysed_and_says_why(gate, monkeypatch):
    analyze, error = gate_runs.find_or_run_analysis, ERRORS[1]

    def refuse_new(client, place, campaign, *others):
        if not others and client.campaigns.get(campaign).spec.version == "v2":
            raise error
        return analyze(client, place, campaign, *others)

    monkeypatch.setattr(gate_runs, "find_or_run_analysis", refuse_new)
    assert find_problems(gate("usual", "--json")) == [str(error)] * 2
