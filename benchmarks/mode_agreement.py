"""How well the modes of failures agree with known causes, by the adjusted Rand index."""

from collections.abc import Sequence

import msgspec
from sklearn.metrics import adjusted_rand_score

from eigenfail.values import AnalysisSettings, Floats
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
    indices = tuple(each.course.index for each in failures)
    batch = FailureBatch(1, Failures(indices, tuple(each.z for each in failures)))
    channels = tuple(f"channel_{number}" for number in range(failures[0].z.shape[1]))
    gathered = gather_failures([batch], horizon, settings, channels)
    motion = read_motion([(1, each.course) for each in failures], "collision")
    step_s = failures[0].course.dt_s
    result = analyse_gathered(gathered._replace(motion=motion, step_s=step_s), settings, step_s, {})
    causes = {each.course.index: each.cause for each in failures}
    truth = [causes[episode] for episode in result.episodes]
    return float(adjusted_rand_score(truth, result.labels))


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
