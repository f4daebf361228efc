"""What became of failure modes in the newest version, against the one before it."""

import pytest

from eigenfail.presentation.releases import compare_newest
from eigenfail.values import release

S = release.ModeStatus


def make_table(courses, problems=None, versions=("v1", "v2", "v3")):
    """Modes as (failures, status) by version; a version with a problem has none."""
    problems = problems or {}
    modes = tuple(
        release.ReleaseMode(
            number=number,
            name=name,
            sightings=tuple(
                release.ModeSighting(version=version, failures=failures, status=status)
                for version, (failures, status) in zip(versions, course, strict=True)
            ),
        )
        for number, (name, course) in enumerate(courses.items(), start=1)
    )
    releases = tuple(
        release.Release(
            version=each,
            campaigns=(1,),
            episodes=9,
            failures=1,
            is_random=True,
            problem=problems.get(each, ""),
        )
        for each in versions
    )
    names = {"planner": "idm", "scenario": "cut_in", "requirements": "r", "method": "monte_carlo"}
    question = release.ReleaseQuestion(
        campaign=1, versions=versions, campaigns=len(versions), **names
    )
    return release.ReleaseTable(question=question, releases=releases, modes=modes)


COURSES = {
    "new": ((0, None), (0, None), (9, S.FIRST_SEEN)),
    "back": ((9, S.FIRST_SEEN), (0, S.NOT_FOUND_AGAIN), (8, S.REGRESSED)),
    "stays": ((9, S.FIRST_SEEN), (9, S.STILL_THERE), (7, S.STILL_THERE)),
    "fixed": ((9, S.FIRST_SEEN), (9, S.STILL_THERE), (0, S.NOT_FOUND_AGAIN)),
    "gone for long": ((9, S.FIRST_SEEN), (0, S.NOT_FOUND_AGAIN), (0, S.NOT_FOUND_AGAIN)),
}


def test_modes_stand_by_what_became_of_them_and_old_ones_are_left_out():
    found = compare_newest(make_table(COURSES))
    assert found.words == "v3 against v2: 1 new, 1 regressed, 1 still there, 1 fixed."
    names = {status: [each.name for each in modes] for status, modes in found.modes.items()}
    assert names == {
        S.FIRST_SEEN: ["new"],
        S.REGRESSED: ["back"],
        S.STILL_THERE: ["stays"],
        S.NOT_FOUND_AGAIN: ["fixed"],
    }


LEFT_OUT = "{}, with 1 failure in 9 episodes, is not compared."


def test_version_that_is_not_compared_is_named_with_its_failures():
    courses = {"fixed": ((9, S.FIRST_SEEN), (0, None), (0, S.NOT_FOUND_AGAIN))}
    found = compare_newest(make_table(courses, {"v2": "Not analysed."}))
    assert (found.before, found.words) == (
        "v1",
        "v2, with 1 failure in 9 episodes, is not compared. Not analysed. v3 against v1: 1 fixed.",
    )


@pytest.mark.parametrize(
    ("problems", "words"),
    [
        ({"v3": "Not analysed."}, "v3 is not compared. Not analysed."),
        (
            {"v1": "X.", "v2": "Y."},
            (
                f"{LEFT_OUT.format('v1')} X. {LEFT_OUT.format('v2')} Y. "
                "v3 is not compared: no version before it can be."
            ),
        ),
        ({}, "v3 against v2: no failure mode in either version."),
    ],
)
def test_without_a_mode_the_reason_is_said(problems, words):
    assert compare_newest(make_table({}, problems)).words == words
