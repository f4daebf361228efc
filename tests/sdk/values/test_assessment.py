"""Classes and lead times, and the digest that covers what they are made of."""

import hashlib
import struct

import msgspec
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from eigenfail.values.disturbance import AXES, NoiseTrajectory
from eigenfail.values.episode import EpisodeResult, Outcome
from eigenfail.values.measures import DIGESTED_MEASURES, Measures
from eigenfail.values.records import IN_WORDS, Assessment, ConflictClass, assess, is_unresolved
from eigenfail.values.scene import PEAK_BRAKING_MPS2
from eigenfail.values.shapes import Correlated, HeavyTailed
from eigenfail_api.routes.episodes import make_episode_detail

replace = msgspec.structs.replace
many = settings(deadline=None, derandomize=True, max_examples=200)
seconds = st.none() | st.floats(0.0, 10.0)
measured = st.builds(
    Measures,
    st.floats(0.0, 50.0),
    severity=st.none(),
    min_ttc_s=st.none() | st.floats(0.01, 10.0),
    max_drac_mps2=st.none(),
    ttc_violated_s=seconds,
    drac_violated_s=seconds,
    drac_at_warning_mps2=st.none() | st.floats(0.1, 60.0),
    collided_s=seconds,
)

CRASH = Measures(
    robustness_m=0.0,
    severity=144.0,
    min_ttc_s=0.02,
    max_drac_mps2=300.0,
    ttc_violated_s=6.5,
    drac_violated_s=8.25,
    drac_at_warning_mps2=4.0,
    collided_s=8.5,
)


def test_a_crash_by_hand() -> None:
    # its largest DRAC is 300 m/s², as at every contact: that is not what it is judged by
    found = assess(Outcome.COLLISION, CRASH)
    assert found == Assessment(ConflictClass.PLANNER_FAILURE, 2.0, 0.25, unresolved=False)
    assert found.words == "collision, planner failure"


@pytest.mark.parametrize(
    ("at_warning_mps2", "conflict"),
    [
        (7.0, ConflictClass.PLANNER_FAILURE),
        (7.01, ConflictClass.UNAVOIDABLE),
        (None, ConflictClass.UNAVOIDABLE),
    ],
)
def test_peak_braking_parts_the_collisions(
    at_warning_mps2: float | None, conflict: ConflictClass
) -> None:
    measures = replace(CRASH, drac_at_warning_mps2=at_warning_mps2)
    assert assess(Outcome.COLLISION, measures).conflict is conflict


@pytest.mark.parametrize(
    ("min_ttc_s", "conflict"),
    [
        (None, ConflictClass.NONE),
        (1.5, ConflictClass.NONE),
        (1.49, ConflictClass.NEAR_MISS),
    ],
)
def test_near_misses(min_ttc_s: float | None, conflict: ConflictClass) -> None:
    measures = Measures(0.4, min_ttc_s=min_ttc_s, drac_violated_s=1.0)
    assert assess(Outcome.SAFE, measures) == Assessment(conflict, unresolved=False)


@pytest.mark.parametrize(
    ("largest_mps2", "last_mps2", "unresolved"),
    [
        (None, 0.0, False),
        (22.0, 7.0, False),
        (22.0, 7.01, True),
        (22.0, 0.0, False),
    ],
)
def test_the_last_step_says_whether_the_end_came_before_the_collision(
    largest_mps2: float | None, last_mps2: float | None, unresolved: bool
) -> None:
    measures = Measures(1.3, None, 0.3, largest_mps2, final_drac_mps2=last_mps2)
    found = assess(Outcome.SAFE, measures)
    assert found == Assessment(ConflictClass.NEAR_MISS, unresolved=unresolved)
    assert (found.words == "near miss, unresolved at the horizon") == unresolved
    assert not assess(Outcome.COLLISION, measures).unresolved


@many
@given(st.floats(0.5, 40.0), st.floats(0.1, 100.0), st.none() | st.floats(1.0, 12.0))
def test_unresolved_is_what_the_brakes_could_not_stop(
    closing_mps: float, gap_m: float, peak_mps2: float | None
) -> None:
    """Against full braking from the last step on, by its stopping distance v² / (2 · b)."""
    drac_mps2 = closing_mps**2 / (2.0 * gap_m)
    stops_in_m = closing_mps**2 / (2.0 * (peak_mps2 or PEAK_BRAKING_MPS2))
    assume(abs(stops_in_m - gap_m) > 1e-9 * gap_m)
    measures = Measures(
        gap_m, None, None, drac_mps2, final_drac_mps2=drac_mps2, peak_braking_mps2=peak_mps2
    )
    assert is_unresolved(measures) is (stops_in_m > gap_m)


def test_what_was_not_run_or_not_measured_has_no_class() -> None:
    assert assess(Outcome.ERRORED, CRASH) == assess(Outcome.SAFE, None)
    assert assess(Outcome.SAFE, None) == Assessment(unresolved=False)
    assert Assessment().words == ""
    older = Measures(0.0, 144.0, 0.02, 300.0)
    assert assess(Outcome.COLLISION, older) == Assessment(unresolved=False)


def test_every_class_has_words() -> None:
    assert set(IN_WORDS) == set(ConflictClass)


@many
@given(st.sampled_from(Outcome), measured)
def test_collisions_and_the_others_never_share_a_class(
    outcome: Outcome, measures: Measures
) -> None:
    found = assess(outcome, measures)
    crashed = {None, ConflictClass.UNAVOIDABLE, ConflictClass.PLANNER_FAILURE}
    allowed = outcome is not Outcome.COLLISION and measures.collided_s is not None
    unclassed = allowed or outcome in {Outcome.COLLISION, Outcome.ERRORED}
    assert (found.conflict in crashed) == unclassed
    if outcome is not Outcome.COLLISION:
        assert (found.ttc_lead_s, found.drac_lead_s) == (None, None)


@many
@given(measured, st.floats(0.0, 20.0))
def test_needing_more_never_turns_unavoidable_into_a_planner_failure(
    measures: Measures, more: float
) -> None:
    need = measures.drac_at_warning_mps2
    worse = replace(measures, drac_at_warning_mps2=None if need is None else need + more)
    if assess(Outcome.COLLISION, measures).conflict is ConflictClass.UNAVOIDABLE:
        assert assess(Outcome.COLLISION, worse).conflict is ConflictClass.UNAVOIDABLE


@many
@given(measured, st.floats(0.0, 5.0))
def test_a_later_collision_was_foreseen_for_longer(measures: Measures, later: float) -> None:
    if measures.collided_s is None or measures.ttc_violated_s is None:
        assert assess(Outcome.COLLISION, measures).ttc_lead_s is None
        return
    delayed = replace(measures, collided_s=measures.collided_s + later)
    leads = [assess(Outcome.COLLISION, each).ttc_lead_s for each in (measures, delayed)]
    assert leads[1] - leads[0] == pytest.approx(later, abs=1e-9)


def result(measures: Measures | None = CRASH, outcome: Outcome = Outcome.COLLISION):
    z = np.linspace(-1.0, 1.0, 6, dtype=np.float32).reshape(3, 2)
    return EpisodeResult(4, 7, outcome, 3, NoiseTrajectory(z, z + 2), "prior", measures)


@pytest.mark.parametrize("name", Measures.__struct_fields__[:DIGESTED_MEASURES])
def test_the_digest_covers_every_measure(name: str) -> None:
    known = replace(CRASH, left_road_s=1.0, max_jerk_mps3=4.0, hard_brakings=1, clipped_steps=0)
    digests = {result(replace(known, **{name: value})).digest() for value in (None, 0, 17)}
    assert len(digests) == 3


def test_what_was_measured_since_leaves_digests_as_they_were() -> None:
    names = Measures.__struct_fields__[DIGESTED_MEASURES:]
    later = replace(CRASH, **dict.fromkeys(("final_drac_mps2", "peak_braking_mps2"), 22.0))
    assert {"final_drac_mps2", "peak_braking_mps2"} < set(names)
    assert result(later).digest() == result().digest()


def test_the_digest_covers_what_requirements_say() -> None:
    judged = replace(CRASH, nearest_m=0.0, violated=1)
    others = (CRASH, judged, replace(judged, violated=2), replace(judged, nearest_m=1.0))
    assert len({result(each).digest() for each in others}) == len(others)


def test_results_of_the_first_release_keep_their_digests() -> None:
    older = result(Measures(0.0, 144.0, None, 300.0))
    packed = struct.pack("<4d", 0.0, 144.0, float("nan"), 300.0)
    arrays = (older.noise.z.tobytes(), older.noise.sigma.tobytes())
    parts = (b"collision", struct.pack("<q", 3), packed, *arrays, b"")
    assert older.digest() == hashlib.sha256(b"\x00".join(parts)).hexdigest()


def test_the_digest_covers_the_shape_where_there_is_noise() -> None:
    white = result()
    shapes = (white.noise.shape, Correlated(), HeavyTailed())
    digests = {replace(white, noise=replace(white.noise, shape=s)).digest() for s in shapes}
    assert len(digests) == 3
    nothing = np.zeros((0, 2), np.float32)
    lost = {replace(white, noise=NoiseTrajectory(nothing, nothing, s)).digest() for s in shapes}
    assert len(lost) == 1


def test_details_are_the_result_and_its_assessment() -> None:
    found = make_episode_detail(1, result(), AXES)
    assert found.assessed == assess(Outcome.COLLISION, CRASH)
    assert found.digest() == result().digest()
    assert found.noise.z.tobytes() == result().noise.z.tobytes()
