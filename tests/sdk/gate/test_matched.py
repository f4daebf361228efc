"""Failure modes of two versions, as the comparison of releases matched them."""

from xml.etree import ElementTree as ET

from eigenfail.gate.matched import MatchedMode, match_versions
from eigenfail.gate.report import GateRun, MemberReport, build_report, list_conclusions, to_junit
from eigenfail.presentation.releases import CHANGES
from eigenfail.values.release import (
    ModeSighting,
    ModeStatus,
    Release,
    ReleaseMode,
    ReleaseQuestion,
    ReleaseTable,
)

VERSIONS = ("v1", "v2", "v3")


def sight(version, failures, status, mode=1):
    found = {"analysis": int(version[1:]), "mode": mode} if failures else {}
    words = f"{failures} failures."
    return ModeSighting(version=version, failures=failures, status=status, words=words, **found)


def make_table(**problems):
    courses = {
        "late": (
            (7, ModeStatus.FIRST_SEEN),
            (0, ModeStatus.NOT_FOUND_AGAIN),
            (9, ModeStatus.REGRESSED),
        ),
        "hard": ((5, ModeStatus.FIRST_SEEN), (4, ModeStatus.STILL_THERE), (0, ModeStatus.NOT_MET)),
        "rare": ((0, None), (3, ModeStatus.FIRST_SEEN), (0, ModeStatus.NOT_FOUND_AGAIN)),
    }
    modes = tuple(
        ReleaseMode(
            number=number,
            name=name,
            sightings=tuple(
                sight(version, *seen, mode=number)
                for version, seen in zip(VERSIONS, course, strict=True)
            ),
        )
        for number, (name, course) in enumerate(courses.items(), start=1)
    )
    releases = tuple(
        Release(
            version=version,
            campaigns=(place,),
            episodes=90,
            failures=9,
            is_random=False,
            problem=problems.get(version, ""),
        )
        for place, version in enumerate(VERSIONS, start=1)
    )
    question = ReleaseQuestion(
        campaign=3,
        planner="idm",
        scenario="cut_in",
        requirements="no collision",
        method="cem",
        versions=VERSIONS,
        campaigns=3,
    )
    return ReleaseTable(question=question, releases=releases, modes=modes)


def test_modes_that_neither_version_has_are_left_out():
    found = match_versions(["a", "b"], make_table(), "v1", "v3")
    told = [(each.name, each.status, each.before, each.now, each.mode) for each in found.modes]
    assert told == [
        ("late", ModeStatus.REGRESSED, 7, 9, "3/1"),
        ("hard", ModeStatus.NOT_MET, 5, 0, "1/2"),
    ]
    assert (found.members, found.campaign, found.problem) == (("a", "b"), 3, "")


def test_statuses_have_the_words_of_releases():
    words = {
        status: MatchedMode(name="late", status=status, before=1, now=1, mode="1/1").status_word
        for status in (*ModeStatus, None)
    }
    assert words == {**CHANGES, None: "not compared"}


def test_no_mode_is_new_in_the_first_version_compared():
    found = match_versions(["a"], make_table(), "v2", "v1")
    assert [(each.now, each.status) for each in found.modes] == [(7, None), (5, None), (0, None)]


def test_versions_that_are_not_compared_have_a_problem():
    table = make_table(v3="Campaign 3 is not analysed.")
    pairs = {
        ("v1", "v2"): "",
        ("", "v2"): "The baseline names no version of the planner.",
        ("v0", "v2"): "The releases of this scenario do not have v0: its planner is another one.",
        ("v1", "v3"): "Campaign 3 is not analysed.",
    }
    for versions, problem in pairs.items():
        found = match_versions(["a"], table, *versions)
        assert found.problem == problem
        assert bool(found.modes) == (not problem)


def test_matched_modes_are_reported_and_judge_nothing():
    gate = GateRun(suite="s", version="v3", run="s @ v3", baseline="v1", strict=True)
    matched = [
        match_versions(["a", "b"], make_table(), "v1", "v3"),
        match_versions(["c"], make_table(), "", "v3"),
    ]
    report = build_report(gate, [MemberReport(member="a")], matched)
    assert (report.open, report.counts) == (True, {})
    conclusions = [*list_conclusions(report)]
    told = "Failure modes matched over releases, reported and not judged: 1 regressed, 1 not met."
    assert told in conclusions
    assert conclusions[-1].startswith("c: failure modes are not matched over releases. The base")
    *_, suite = ET.fromstring(to_junit(report))
    assert suite.get("name") == "s: failure modes over releases"
    cases = [*suite.iter("testcase")]
    names = ["late: regressed", "hard: not met", "failure modes are not matched"]
    assert [each.get("name") for each in cases] == names
    assert [each.get("classname").rpartition(".")[2] for each in cases] == ["a, b", "a, b", "c"]
    for case in cases:
        assert case.find("skipped").get("message") == "not judged"
    assert "9 failures, 7 in the baseline (mode 3/1)" in cases[0].find("skipped").text
