"""Failures grouped by what the ego did: planted behaviours, and what stands in for them."""

from typing import Any

import numpy as np
import pytest
from ego_courses import gather_courses
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from sklearn.metrics import adjusted_rand_score

from eigenfail.values.analysis import AnalysisResult, AnalysisSettings
from eigenfail.values.arrays import Floats
from eigenfail.values.records import FailureCourse, Failures
from eigenfail_services.analysis import behaviour, clusters
from eigenfail_services.analysis.alignment import Aligned, FailureBatch, gather_failures
from eigenfail_services.analysis.job import analyse_gathered

HORIZON, STEP_S, FAILURES = 80, 0.1, 90
DEFAULT = AnalysisSettings(bootstrap=0)


@pytest.fixture(autouse=True)
def few_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    """Planted behaviours are far above noise."""
    monkeypatch.setattr(clusters, "NOISE_DRAWS", 2)


class World:
    """Failures of three causes, whose noise shows nothing: it pushes to either side at random.

    0: the ego does not brake. 1: it brakes at 7 m/s² from 1.5 s before the collision on. 2: it
    brakes at 3 m/s² from 4.0 to 2.5 s before the collision.
    """

    def __init__(self, seed: int = 0, failures: int = FAILURES) -> None:
        random = np.random.default_rng(seed)
        self.labels = random.integers(0, 3, failures)
        self.noise: list[Floats] = []
        self.courses: list[FailureCourse] = []
        for index, label in enumerate(self.labels):
            steps = int(random.integers(50, HORIZON + 1))
            noise = random.standard_normal((steps, 2))
            noise[-35:-20, label % 2] += random.choice([-2.0, 2.0])
            acceleration = 0.3 * random.standard_normal(steps)
            if label == 1:
                acceleration[-15:] -= 7.0
            if label == 2:
                acceleration[-40:-25] -= 3.0
            speeds = 24.0 + STEP_S * np.concatenate([[0.0], np.cumsum(acceleration)])
            self.noise.append(noise.astype(np.float32))
            self.courses.append(FailureCourse(index, STEP_S, speeds.astype(np.float32)))

    def gather(self, order: list[int] | None = None, **changes: Any) -> Aligned:
        """The failures, with what the ego did in them, read in some order."""
        order = list(range(len(self.noise))) if order is None else order
        failures = Failures(tuple(order), tuple(self.noise[index] for index in order))
        asked = replace(DEFAULT, **changes)
        courses = [(1, self.courses[index]) for index in order]
        return gather_failures([FailureBatch(1, failures)], HORIZON, asked)._replace(
            motion=behaviour.read_motion(courses, "collision")
        )


def analyse(failures: Aligned, **changes: Any) -> AnalysisResult:
    timed = failures._replace(step_s=STEP_S)
    return analyse_gathered(timed, replace(DEFAULT, **changes), STEP_S, {})


def test_planted_behaviours_are_found_where_noise_shows_nothing() -> None:
    world = World()
    found = analyse(world.gather(), bootstrap=3)
    assert (found.features, len(found.modes), found.distinct) == ("behaviour", 3, True)
    assert adjusted_rand_score(world.labels, found.labels) == 1.0
    by_noise = analyse(world.gather(), features="noise")
    assert (by_noise.features, by_noise.behaviour) == ("noise", None)
    assert adjusted_rand_score(world.labels, by_noise.labels) < 0.6
    words = {
        int(world.labels[found.labels.index(place)]): mode.words
        for place, mode in enumerate(found.behaviour.modes)
    }
    assert words[0].startswith("The ego hardly brakes, at up to 0.")
    assert words[1].startswith("The ego brakes at up to 7.")
    assert words[1].endswith("from 1.5 to 0.0 s before the collision.")
    assert "from 4.0 to 2.5 s before the collision" in words[2]


def test_components_of_noise_stand_beside_and_each_mode_has_its_own() -> None:
    world = World()
    found, by_noise = (analyse(world.gather(), features=one) for one in ("behaviour", "noise"))
    for field in ("components", "explained", "scores", "influence"):
        assert np.array_equal(getattr(found, field), getattr(by_noise, field))
    for place, mode in enumerate(found.modes):
        members = np.flatnonzero(np.array(found.labels) == place)
        padded = np.zeros((len(members), HORIZON, 2))
        for row, member in zip(padded, members, strict=True):
            row[: len(world.noise[member])] = world.noise[member]
        centred = (padded - padded.mean(axis=0)).reshape(len(members), -1)
        _, singular, directions = np.linalg.svd(centred, full_matrices=False)
        shares = singular**2 / np.sum(singular**2)
        assert mode.explained == pytest.approx(shares[:3], abs=1e-5)
        cosines = np.sum(mode.components.reshape(3, -1) * directions[:3], axis=1)
        assert np.abs(cosines) == pytest.approx(1.0, abs=1e-4)
        reached = [z[10] for z in (world.noise[member] for member in members)]
        assert mode.eigenfailure[10] == pytest.approx(np.median(reached, axis=0), abs=1e-5)
        # The medoid is a failure of the mode, by what the ego did.
        assert mode.medoid in members
        own = found.behaviour.scores[members]
        away = np.linalg.norm(own - own.mean(axis=0), axis=1)
        assert mode.medoid == members[np.argmin(away)]


@settings(max_examples=20, deadline=None)
@given(st.lists(st.integers(1, HORIZON), min_size=1, max_size=5), st.sampled_from([0.05, 0.1, 0.2]))
def test_acceleration_is_aligned_at_the_collision_or_the_start(lengths, step_s) -> None:
    random = np.random.default_rng(len(lengths))
    noise = tuple(random.standard_normal((steps, 2)).astype(np.float32) for steps in lengths)
    wanted = [random.standard_normal(steps) for steps in lengths]
    courses = [
        (1, FailureCourse(index, step_s, np.concatenate([[20.0], 20.0 + step_s * np.cumsum(each)])))
        for index, each in enumerate(wanted)
    ]
    batch = FailureBatch(1, Failures(tuple(range(len(lengths))), noise))
    gathered = gather_failures([batch], HORIZON, DEFAULT)
    window = min(HORIZON, round(4.5 / step_s))
    for origin, length in (("collision", window), ("start", HORIZON)):
        motion = behaviour.read_motion(courses, origin)
        assert motion is not None
        aligned = behaviour.align_motion(gathered, motion)
        assert aligned.shape == (len(lengths), length)
        for row, index in zip(aligned, gathered.episodes.tolist(), strict=True):
            own = np.zeros(length)
            last = wanted[index][-length:]
            own[slice(length - len(last), None) if origin == "collision" else slice(len(last))] = (
                last
            )
            assert row == pytest.approx(own, abs=1e-3)


@settings(max_examples=20, deadline=None)
@given(st.integers(1, 40), st.sampled_from([0.05, 0.1, 0.25, 1.0, 2.0]), st.integers(0, 9))
def test_acceleration_is_averaged_over_the_steps_around_each(steps, step_s, seed) -> None:
    given_ = np.random.default_rng(seed).standard_normal((3, steps)).astype(np.float32)
    half = {0.05: 14, 0.1: 7, 0.25: 2, 1.0: 0, 2.0: 0}[step_s]
    for place, mean in enumerate(behaviour.smooth_accelerations(given_, step_s).T):
        near = given_[:, max(place - half, 0) : place + half + 1]
        assert mean == pytest.approx(near.mean(axis=1), abs=1e-5)


def test_braking_that_begins_a_little_later_is_no_mode_of_its_own() -> None:
    """Its onset differs by up to 0.8 s; the other failures do not brake."""
    random = np.random.default_rng(2)
    labels = np.repeat([0, 1], 40)
    accelerations = 0.1 * random.standard_normal((80, 60))
    for acceleration, label in zip(accelerations, labels, strict=True):
        first = 30 + random.integers(0, 9)
        acceleration[first : first + 12] -= 7.0 * label
    found = analyse(gather_courses(accelerations))
    assert adjusted_rand_score(labels, found.labels) == 1.0


def brake(strength_mps2: float) -> Floats:
    """The acceleration of an ego that brakes from 2 s before the collision on."""
    acceleration = np.zeros(60)
    acceleration[40:] = -strength_mps2
    return acceleration


@pytest.mark.parametrize("clusterer", ["kmeans", "hdbscan", "gaussian_mixture"])
@pytest.mark.parametrize("courses", [2, 3, 4])
def test_each_of_several_exactly_equal_courses_is_a_mode(courses: int, clusterer: Any) -> None:
    """As of a deterministic planner: 30 failures of each."""
    labels = np.repeat(np.arange(courses), 30)
    failures = gather_courses([brake(7.0 * label) for label in labels])
    found = analyse(failures, clusterer=clusterer)
    assert adjusted_rand_score(labels, found.labels) == 1.0
    assert (len(found.modes), found.distinct) == (courses, True)
    # Each failure by itself is no mode.
    few = analyse(gather_courses([brake(7.0 * label) for label in range(2)]), clusterer=clusterer)
    assert len(few.modes) == 1


@pytest.mark.parametrize("clusterer", ["kmeans", "hdbscan", "gaussian_mixture"])
def test_courses_that_differ_by_less_than_the_resolution_are_a_single_group(clusterer: Any) -> None:
    random = np.random.default_rng(1)
    near = [brake(7.0 + 0.2 * label + 1e-3 * random.random()) for label in np.repeat([0, 1], 30)]
    found = analyse(gather_courses(near), clusterer=clusterer)
    assert (found.features, len(found.modes), found.distinct) == ("behaviour", 1, False)


def test_a_rare_course_is_a_mode_although_the_spread_of_all_is_small() -> None:
    labels = np.repeat([0, 1], [297, 3])
    found = analyse(gather_courses([brake(4.0 * label) for label in labels]), clusters=2)
    assert adjusted_rand_score(labels, found.labels) == 1.0


@pytest.mark.parametrize("change", ["missing", "too short", "not finite", "of two durations"])
def test_without_the_motion_of_every_failure_they_are_grouped_by_energy(change: str) -> None:
    world = World(failures=30)
    first = world.courses[0]
    other = {
        "missing": [],
        "too short": [replace(first, speed_mps=first.speed_mps[:20])],
        "not finite": [replace(first, speed_mps=np.full_like(first.speed_mps, np.nan))],
        "of two durations": [replace(first, dt_s=0.2)],
    }[change]
    courses = [(1, each) for each in (*other, *world.courses[1:])]
    failures = world.gather()._replace(motion=behaviour.read_motion(courses, "collision"))
    found = analyse(failures)
    assert (found.features, found.behaviour) == ("energy", None)
    # Without a duration of steps there are no windows either.
    assert analyse_gathered(failures, DEFAULT, None, {}).features == "noise"


@pytest.mark.parametrize("align", ["start", "collision"])
def test_energy_is_summed_over_windows_of_the_steps_of_a_failure(align: Any) -> None:
    noise = tuple(np.full((steps, 2), value, np.float32) for steps, value in ((12, 2.0), (7, 3.0)))
    asked = replace(DEFAULT, align=align)
    gathered = gather_failures([FailureBatch(1, Failures((0, 1), noise))], 12, asked)
    energy = behaviour.compute_energy(gathered, STEP_S)[np.argsort(gathered.episodes)]
    counts = {
        "start": ([5, 5, 2], [5, 2, 0]),
        "collision": ([2, 5, 5], [0, 2, 5]),
    }[align]
    for row, steps, excess in zip(energy, counts, (3.0, 8.0), strict=True):
        assert row.reshape(3, 2) == pytest.approx(np.array(steps)[:, None] * [[excess, excess]])


def test_energy_finds_pushes_of_either_sign() -> None:
    """Their means vanish, so that K-means of the noise would part them by their sign."""
    random = np.random.default_rng(5)
    labels = np.repeat([0, 1], 60)
    noise = random.standard_normal((120, HORIZON, 2))
    for row, label in zip(noise, labels, strict=True):
        steps = slice(10, 20) if label else slice(40, 50)
        row[steps, 1] += random.choice([-3.0, 3.0])
    failures = Failures(tuple(range(120)), tuple(noise.astype(np.float32)))
    gathered = gather_failures([FailureBatch(1, failures)], HORIZON, DEFAULT)
    found = analyse(gathered, clusters=2)
    assert found.features == "energy"
    assert adjusted_rand_score(labels, found.labels) == 1.0
    assert adjusted_rand_score(labels, analyse(gathered, features="noise").labels) < 0.9


ACCELERATES = (
    "The ego does not brake, and accelerates at up to 2.0 m/s² from 1.5 to 0.0 s before the "
    "collision."
)
TIMES_S = np.arange(-44, 1) * STEP_S


@pytest.mark.parametrize(
    ("first", "last", "strength", "words"),
    [
        (0, 45, 0.0, "The ego does not brake."),
        (10, 20, -0.4, "The ego hardly brakes, at up to 0.4 m/s²."),
        (20, 40, -7.0, "The ego brakes at up to 7.0 m/s² from 2.5 to 0.5 s before the collision."),
        (
            30,
            45,
            2.0,
            ACCELERATES,
        ),
    ],
)
def test_behaviour_is_described_in_words(first, last, strength, words) -> None:
    accelerations = np.zeros((3, 45), np.float32)
    accelerations[:, first:last] = strength
    assert behaviour.describe_motion(accelerations, TIMES_S, STEP_S, "collision") == words


def test_times_count_from_the_start_where_failures_need_not_end_in_a_collision() -> None:
    accelerations = np.zeros((1, 50), np.float32)
    accelerations[0, 20:30] = -3.0
    words = behaviour.describe_motion(accelerations, np.arange(1, 51) * STEP_S, STEP_S, "start")
    assert words == "The ego brakes at up to 3.0 m/s² from 2.0 to 3.0 s after the start."
