"""What the ego collided with: which vehicle, at which side, and what it does to the modes."""

from typing import Any

import numpy as np
import pytest
from ego_courses import EGO, SIZES, STEP_S, STEPS, gather_courses
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from sklearn.metrics import adjusted_rand_score

from eigenfail.presentation.analyses import describe_grouping
from eigenfail.values.analysis import AnalysisResult, AnalysisSettings
from eigenfail.values.arrays import Floats
from eigenfail.values.records import FailureCourse
from eigenfail.values.scene import Scene
from eigenfail_services.analysis import clusters
from eigenfail_services.analysis.alignment import Aligned
from eigenfail_services.analysis.behaviour import describe_contacts, mark_struck, read_motion
from eigenfail_services.analysis.footprints import Contact, find_contact, find_struck
from eigenfail_services.analysis.job import analyse_gathered, hash_result

DEFAULT = AnalysisSettings(bootstrap=0)
ABSENT = (np.nan,) * 4
AHEAD, BEHIND = (10.0, 0.0, 0.0, 10.0), (-10.0, 0.0, 0.0, 30.0)
FAR = (90.0, 3.5, 0.0, 20.0)

FRONT, REAR = Contact(1, "front"), Contact(2, "rear")


@pytest.fixture(autouse=True)
def few_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    """Vehicles that are struck are far above noise."""
    monkeypatch.setattr(clusters, "NOISE_DRAWS", 2)


@pytest.mark.parametrize(
    ("before", "after", "side"),
    [
        ((11.0, 0.0, 0.0), (10.0, 0.0, 0.0), "front"),
        ((-11.0, 0.0, 0.0), (-10.0, 0.0, 0.0), "rear"),
        ((2.0, 2.4, 0.0), (2.0, 2.2, 0.0), "left side"),
        ((-2.0, -2.4, 0.0), (-2.0, -2.2, 0.0), "right side"),
        # It overlaps by 0.15 m of its width, and by 1 m of its length after the step.
        ((10.7, 2.1, 0.0), (9.5, 2.1, 0.0), "front"),
        # Across the road.
        ((9.2, 0.0, np.pi / 2), (8.5, 0.0, np.pi / 2), "front"),
    ],
)
def test_the_side_is_the_one_on_which_the_vehicle_was_before_the_contact(before, after, side):
    end = np.array([[EGO, FAR, (*before, 10.0)], [EGO, FAR, (*after, 10.0)]], np.float32)
    assert find_contact(end, SIZES) == Contact(2, side)


@settings(max_examples=30, deadline=None)
@given(st.floats(-3.0, 3.0), st.floats(-50.0, 50.0), st.floats(-50.0, 50.0))
def test_the_contact_is_the_same_wherever_the_road_leads(heading, x, y):
    end = np.array([[EGO, FAR, (11.0, 1.0, 0.1, 10.0)], [EGO, FAR, (10.0, 1.0, 0.1, 10.0)]])
    cos, sin = np.cos(heading), np.sin(heading)
    turned = end.copy()
    turned[..., 0] = x + cos * end[..., 0] - sin * end[..., 1]
    turned[..., 1] = y + sin * end[..., 0] + cos * end[..., 1]
    turned[..., 2] += heading
    assert find_contact(turned, SIZES) == find_contact(end, SIZES) == Contact(2, "front")


def test_a_vehicle_that_appears_in_the_contact_has_its_side_there():
    end = np.array([[EGO, FAR, ABSENT], [EGO, FAR, BEHIND]], np.float32)
    assert find_contact(end, SIZES) == find_contact(end[-1:], SIZES) == Contact(2, "rear")


def test_without_another_vehicle_there_is_no_contact():
    end = np.array([[EGO, FAR], [EGO, ABSENT]], np.float32)
    assert find_contact(end, SIZES[:2]) is None
    assert find_contact(end[:, :1], SIZES[:1]) is None


@settings(max_examples=30, deadline=None)
@given(st.lists(st.sampled_from([AHEAD, BEHIND, FAR, (3.0, 3.5, 0.2, 9.0)]), min_size=1))
def test_the_vehicle_struck_is_that_of_the_scene(others):
    vehicles = np.array([[EGO, *others]] * 2, np.float32)
    sizes = np.array([(16.0, 2.5), *[(5.0, 2.0)] * len(others)], np.float32)
    none = np.zeros((1, 2), np.float32)
    contact = find_contact(vehicles, sizes)
    assert contact.struck == find_struck(Scene(STEP_S, vehicles, sizes, none, none))


@pytest.mark.parametrize(
    ("counts", "columns"),
    [
        ({1: 40}, []),
        ({1: 20, 3: 20}, [20, 20]),
        # Few: they share the first column.
        ({1: 30, 2: 4, 5: 1}, [5, 30]),
        ({1: 97, 2: 3}, [3, 97]),
        # In random traffic each vehicle has another number.
        (dict.fromkeys(range(1, 41), 1), []),
        (dict.fromkeys(range(1, 31), 5), []),
    ],
)
def test_each_vehicle_that_many_failures_strike_has_a_column(counts, columns):
    contacts = [Contact(vehicle, "front") for vehicle, n in counts.items() for _ in range(n)]
    marks = mark_struck(contacts)
    assert marks.sum(axis=0).tolist() == columns
    assert marks.shape == (len(contacts), len(columns))
    assert not columns or np.array_equal(marks.sum(axis=1), np.ones(len(contacts)))


def analyse(failures: Aligned, **changes: Any) -> AnalysisResult:
    return analyse_gathered(failures, replace(DEFAULT, **changes), STEP_S, {})


def brake(random: np.random.Generator, strength_mps2: float) -> Floats:
    """The acceleration of an ego that brakes from 1.5 s before the collision on."""
    acceleration = 0.2 * random.standard_normal(STEPS)
    acceleration[-15:] -= strength_mps2
    return acceleration


def make_planted(seed: int = 0, failures: int = 60) -> tuple[Any, list[Floats], list[Any]]:
    """Three causes: 0 strikes vehicle 1 and 1 vehicle 2, with the same braking; 2 does not brake.

    It strikes vehicle 2.
    """
    random = np.random.default_rng(seed)
    labels = np.concatenate([[0, 1, 2], random.integers(0, 3, failures - 3)])
    accelerations = [brake(random, 0.0 if label == 2 else 7.0) for label in labels]
    others = [(AHEAD, FAR) if label == 0 else (FAR, BEHIND) for label in labels]
    return labels, accelerations, others


@pytest.mark.parametrize("clusterer", ["kmeans", "hdbscan", "gaussian_mixture"])
def test_two_vehicles_that_are_struck_with_the_same_braking_are_two_modes(clusterer):
    labels, accelerations, others = make_planted()
    found = analyse(gather_courses(accelerations, others), bootstrap=3, clusterer=clusterer)
    assert (found.features, len(found.modes), found.distinct) == ("behaviour", 3, True)
    assert adjusted_rand_score(labels, found.labels) == 1.0
    assert found.behaviour.struck == tuple(1 if label == 0 else 2 for label in labels)
    words = {
        int(labels[found.labels.index(place)]): mode.words
        for place, mode in enumerate(found.behaviour.modes)
    }
    assert words[0].startswith(
        "The front of the ego collides with vehicle 1. The ego brakes at up to 7."
    )
    assert words[1].startswith(
        "The rear of the ego collides with vehicle 2. The ego brakes at up to 7."
    )
    assert words[2].startswith("The rear of the ego collides with vehicle 2. The ego hardly brakes")
    assert describe_grouping(found) == (
        "the acceleration of the ego before the collision, and by the vehicle that it struck"
    )


def test_without_what_was_struck_the_same_failures_are_two_modes():
    labels, accelerations, others = make_planted()
    failures = gather_courses(accelerations, others)
    contacts = dict(failures.motion.contacts)
    contacts.pop((1, 7))  # one unknown contact is enough
    motion = failures.motion._replace(contacts=contacts)
    found = analyse(failures._replace(motion=motion))
    assert adjusted_rand_score(labels == 2, found.labels) == 1.0
    assert found.behaviour.struck == ()
    assert describe_grouping(found) == "the acceleration of the ego before the collision"


def test_where_one_vehicle_is_struck_nothing_is_different():
    _, accelerations, _ = make_planted()
    failures = gather_courses(accelerations, [(AHEAD, FAR)] * len(accelerations))
    known = analyse(failures)
    unknown = analyse(failures._replace(motion=failures.motion._replace(contacts={})))
    assert hash_result(known) == hash_result(unknown)
    assert np.array_equal(known.behaviour.scores, unknown.behaviour.scores)
    assert [mode.words for mode in known.behaviour.modes] == [
        mode.words for mode in unknown.behaviour.modes
    ]
    assert known.behaviour.struck == ()


def test_an_analysis_of_noise_knows_nothing_of_what_was_struck():
    _, accelerations, others = make_planted()
    failures = gather_courses(accelerations, others)
    digests = {
        hash_result(analyse(each, features="noise"))
        for each in (failures, failures._replace(motion=None))
    }
    assert len(digests) == 1


def test_failures_that_need_not_be_collisions_strike_nothing():
    _, accelerations, others = make_planted(failures=6)
    courses = [
        (1, FailureCourse(index, STEP_S, np.ones(STEPS + 1, np.float32), end, SIZES))
        for index, end in enumerate(np.array([[EGO, *each]] * 2, np.float32) for each in others)
    ]
    origins = {"collision": len(accelerations), "start": 0}
    for origin, known in origins.items():
        motion = read_motion(courses, origin)
        assert len(motion.contacts) == known


@settings(max_examples=4, deadline=None)
@given(st.permutations(range(30)), st.integers(0, 3))
def test_the_order_in_which_failures_were_found_and_read_does_not_matter(order, seed):
    _, accelerations, others = make_planted(seed, 30)
    sorted_, mixed = (
        analyse(gather_courses(accelerations, others, each)) for each in (None, order)
    )
    assert hash_result(sorted_) == hash_result(mixed)
    assert sorted_.behaviour.struck == mixed.behaviour.struck
    assert [mode.words for mode in sorted_.behaviour.modes] == [
        mode.words for mode in mixed.behaviour.modes
    ]


@pytest.mark.parametrize(
    ("groups", "sentences"),
    [
        ([[FRONT, FRONT], [FRONT]], ["", ""]),
        ([[], []], ["", ""]),
        (
            [[FRONT] * 3, [REAR, FRONT, REAR]],
            [
                "The front of the ego collides with vehicle 1.",
                "The rear of the ego collides with vehicle 2 in 2 of 3 failures.",
            ],
        ),
        (
            [[FRONT], [Contact(1, "left side")]],
            [
                "The front of the ego collides with vehicle 1.",
                "The left side of the ego collides with vehicle 1.",
            ],
        ),
    ],
)
def test_contacts_are_told_where_modes_differ_in_them(groups, sentences):
    assert list(describe_contacts(groups)) == sentences
