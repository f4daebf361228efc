"""Failure modes that only the new planner has: judged of Monte Carlo, told of searches."""

import json
import re
from xml.etree import ElementTree as ET


def test_by_rate_the_failures_of_both_are_analysed_together_once(gate, baseline, store):
    def together():
        every = store.analyses.page(100).items
        return [
            (each.campaign, *each.settings.campaigns) for each in every if each.settings.campaigns
        ]

    first = gate("usual", "--by", "rate", "--json")
    reruns = [member["rerun"] for member in json.loads(first.stdout)["members"]]
    assert all(rerun["by"] == "rate" for rerun in reruns), first.output
    failing = [
        (rerun["before"]["campaign"], rerun["now"]["campaign"])
        for rerun in reruns
        if rerun["modes"]
    ]
    assert failing
    assert sorted(together()) == sorted(failing)
    again = gate("usual", "--by", "rate", "--json")
    assert (again.stdout, sorted(together())) == (first.stdout, sorted(failing))


def with_new_mode(done):
    """The reruns that have one."""
    reruns = [member["rerun"] for member in json.loads(done.stdout)["members"]]
    found = [rerun for rerun in reruns if rerun["modes"].startswith("New mode 2 (The ego ")]
    assert found, done.output
    return found


def test_a_new_mode_at_an_equal_rate_closes_the_gate(gate, parted):
    done = gate("usual", "--by", "rate", "--json")
    assert done.exit_code == 1, done.output
    for rerun in with_new_mode(done):
        assert rerun["verdict"] == rerun["new_modes"][0]["verdict"] == "new"
        assert rerun["new_modes"][0]["replay"].startswith("eigenfail episode replay ")


def test_a_new_mode_of_a_search_is_told_with_its_replay_and_closes_nothing(
    eigenfail, suite, parted, tmp_path
):
    file, written = suite(method="cem"), tmp_path / "gate.xml"
    assert eigenfail("gate", file, "--planner-version", "c1").exit_code == 0
    words = ("gate", file, "--planner-version", "c2", "--baseline", "c1")
    done = eigenfail(*words, "--json", "--junit", written)
    assert done.exit_code == 0, done.output
    told = with_new_mode(done)
    for rerun in told:
        assert (rerun["verdict"], rerun["new_modes"][0]["verdict"]) == ("still failing", "unproven")
        assert "Reported, not judged: failures of cem are not independent" in rerun["modes"]
    cases = [
        case
        for case in ET.fromstring(written.read_bytes()).iter("testcase")
        if case.get("classname").endswith(".new modes")
        and case.find("skipped[@message='not judged']") is not None
    ]
    assert len(cases) == len(told)
    page = eigenfail(*words).stdout
    assert f"not judged: failure modes of searches that only c2 has: {len(told)}." in page
    assert re.search(r"new mode 2: .* unproven +eigenfail episode replay", page)
