"""A proof in sentences: what was counted, and what to do where a centre is no failure."""

import pytest

from eigenfail.presentation.analyses import NO_FAILURE, count_reproductions, describe_proof
from eigenfail.values.campaign import CampaignState
from eigenfail.values.estimates import Interval, Rate
from eigenfail.values.proof import Proof, ProvenMode, ProvenScenario, Reproduction

EVERYTHING = Interval(0.0, 1.0)


def reproduced(k: int, n: int) -> Reproduction:
    return Reproduction() if n == 0 else Reproduction(Rate(k / n, k, n, EVERYTHING), 1.25)


def proof(*modes: tuple[int, int], scenarios: int = 1) -> Proof:
    """Of each mode: how many replays of its eigenfailure and medoid failed, of `scenarios`."""
    eigenfailures, medoids = (sum(counts) for counts in zip(*modes, strict=True))
    n = len(modes) * scenarios
    one = ProvenScenario(
        scenario_parameters={},
        campaign=1,
        state=CampaignState.DONE,
        eigenfailures=reproduced(eigenfailures, n),
        medoids=reproduced(medoids, n),
        replays=(),
    )
    return Proof(
        analysis=1,
        done=True,
        reproduced=reproduced(eigenfailures, n),
        eigenfailures=reproduced(eigenfailures, n),
        medoids=reproduced(medoids, n),
        modes=tuple(
            ProvenMode(place, reproduced(first, scenarios), reproduced(second, scenarios))
            for place, (first, second) in enumerate(modes)
        ),
        scenarios=(one,) * scenarios,
    )


def test_replays_are_counted_and_not_the_eigenfailures() -> None:
    sentences = [*count_reproductions(proof((3, 3), (2, 3), scenarios=3))]
    assert sentences[1:3] == [
        "5 of 6 replays of eigenfailures reproduced a failure (2 modes, 3 scenarios).",
        "6 of 6 replays of medoids reproduced a failure (2 modes, 3 scenarios).",
    ]


@pytest.mark.parametrize(("failed", "warned"), [(0, True), (1, False)])
def test_a_centre_that_never_fails_is_called_no_failure(failed: int, warned: bool) -> None:
    sentences = [*count_reproductions(proof((failed, 1)))]
    assert (f"Mode 1: {NO_FAILURE}" in sentences) is warned
    assert f"Mode 1: eigenfailure {failed} of 1" in sentences[1]


def test_replays_of_groups_are_counted_as_such() -> None:
    table, *sentences = describe_proof(proof((1, 1), (0, 1), scenarios=2), "group")
    assert table.columns[1].title == "Group"
    assert "(2 groups, 2 scenarios)" in sentences[1]
    assert sentences[3] == "Group 1: eigenfailure 1 of 2; medoid 1 of 2."
    assert not any("mode" in sentence.lower() for sentence in sentences)


def test_what_was_not_replayed_is_no_success() -> None:
    (first, *_) = count_reproductions(proof((0, 0), scenarios=0))
    assert first == "None of the eigenfailures was completed in the same scenario."
