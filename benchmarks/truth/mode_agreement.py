"""Modes of the failures of one campaign: how many, and how well they agree with known causes."""

from collections.abc import Sequence

import msgspec
from sklearn.metrics import adjusted_rand_score

from eigenfail.values.analysis import AnalysisResult, AnalysisSettings
from eigenfail.values.arrays import Floats
from eigenfail.values.records import FailureCourse, Failures
from eigenfail_services.analysis.alignment import FailureBatch, gather_failures
from eigenfail_services.analysis.behaviour import read_motion
from eigenfail_services.analysis.footprints import find_contact
from eigenfail_services.analysis.job import analyse_gathered


class LabelledFailure(msgspec.Struct, frozen=True, eq=False):
    """A failure of which the cause is known.

    Attributes:
        z: noise, shape (steps, channels). [sigma]
        course: course of the failure, with the index of the episode.
        cause: name of the cause.
    """

    z: Floats
    course: FailureCourse
    cause: str


def measure_agreement(
    failures: Sequence[LabelledFailure], horizon: int, settings: AnalysisSettings
) -> float:
    """Return the index of the modes of an analysis with the causes; 1 where they are the same.

    Args:
        failures: failures of one campaign.
        horizon: steps of a full episode.
        settings: settings of the analysis.
    """
    courses = [each.course for each in failures]
    result = analyse_courses([each.z for each in failures], courses, horizon, settings)
    causes = {each.course.index: each.cause for each in failures}
    truth = [causes[episode] for episode in result.episodes]
    return float(adjusted_rand_score(truth, result.labels))


def count_modes(noise: Sequence[Floats], courses: Sequence[FailureCourse], horizon: int) -> int:
    """Return the number of distinct modes of failures; one where groups are not distinct.

    Args:
        noise: z of each failure, shape (its steps, channels). [sigma]
        courses: course of each failure.
        horizon: steps of a full episode.
    """
    if not noise:
        return 0
    result = analyse_courses(noise, courses, horizon, AnalysisSettings())
    return len(result.modes) if result.distinct else 1


def analyse_courses(
    noise: Sequence[Floats],
    courses: Sequence[FailureCourse],
    horizon: int,
    settings: AnalysisSettings,
) -> AnalysisResult:
    """Return the analysis of all failures of one campaign; arguments as in `count_modes`."""
    indices = tuple(course.index for course in courses)
    batch = FailureBatch(1, Failures(indices, tuple(noise)))
    channels = tuple(f"channel_{number}" for number in range(noise[0].shape[1]))
    gathered = gather_failures([batch], horizon, settings, channels)
    motion = read_motion([(1, course) for course in courses], "collision")
    step_s = courses[0].dt_s
    return analyse_gathered(gathered._replace(motion=motion, step_s=step_s), settings, step_s, {})


def measure_agreement_of_struck(failures: Sequence[LabelledFailure]) -> float:
    """Return the index of the vehicles that were struck, as groups, with the causes.

    Args:
        failures: failures of one campaign; where vehicles were at their end is known.
    """
    contacts = [
        find_contact(each.course.end, each.course.sizes)
        for each in failures
        if each.course.end is not None and each.course.sizes is not None
    ]
    struck = [0 if contact is None else contact.struck for contact in contacts]
    return float(adjusted_rand_score([each.cause for each in failures], struck))
