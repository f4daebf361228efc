"""Features for grouping failures: behaviour of the ego, or energy of the noise.

Noise by itself separates causes badly: the few decisive steps lie seconds before the impact, among
many irrelevant steps. Noise of opposite signs may have the same effect and would average out. The
behaviour of the ego before a collision follows from the cause, and contains little noise. If the
ego behaves in the same way before collisions with different vehicles, the vehicles separate the
causes.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from math import ceil, sqrt
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenfail.values.analysis import AnalysisSettings, Behaviour, Grouping, ModeBehaviour
from eigenfail.values.arrays import Floats
from eigenfail.values.records import FailureCourse
from eigenfail_services.analysis.alignment import ALIGNMENTS, BLOCK, Aligned, Motion
from eigenfail_services.analysis.footprints import Contact, find_contact

if TYPE_CHECKING:  # it imports scikit-learn, which the API, a reader of behaviour, does without
    from eigenfail_services.analysis.components import ComponentSpace

Origin = Literal["collision", "start"]

WINDOW_S = 4.5
"""Time before the collision of which the acceleration counts. [s]"""

SMOOTHING_S = 1.5
"""Length of the moving mean of the acceleration: braking a little later makes little difference in
it. [s]"""

RESOLUTION_MPS2 = 0.3
"""Root mean square, over the steps, of a difference in acceleration that makes no mode. [m/s²]"""

STRUCK_MPS2 = 4.0
"""Root mean square of a difference in acceleration that makes as much of a difference between two
failures as that they struck different vehicles. [m/s²]"""

FEWEST_STRUCK, LEAST_STRUCK = 5, 0.05
"""Number and share of the failures from which a vehicle that was struck counts by itself. All other
vehicles count as one: in random traffic the number of a vehicle says nothing."""

COMPONENTS = 4
"""Principal components of the acceleration, or of the energy, that are clustered. Vehicles that
were struck add one each but for the first."""

ENERGY_S = 0.5
"""Length of the windows over which the energy of the noise is summed. [s]"""

DECIMALS = 3
"""Decimals of the acceleration that count. [m/s²]"""

MOST_MEMBERS = 20
"""Failures of a mode whose acceleration is kept at most."""

FAINT_MPS2 = 0.1
"""Weaker braking is described as none. [m/s²]"""

SLIGHT_MPS2 = 2.0
"""Weaker braking is described without its time, weaker acceleration not at all. [m/s²]"""


def read_motion(courses: Iterable[tuple[int, FailureCourse]], origin: Origin) -> Motion | None:
    """Return the motion in failures, from the course of each and the id of its campaign.

    None without courses, or if steps have different durations.
    """
    found: dict[tuple[int, int], Floats] = {}
    contacts: dict[tuple[int, int], Contact] = {}
    durations_s: set[float] = set()
    for campaign, course in courses:
        durations_s.add(course.dt_s)
        accelerations = np.diff(course.speed_mps.astype(np.float64)) / course.dt_s
        if origin == "collision":
            accelerations = accelerations[-round(WINDOW_S / course.dt_s) :]
            if course.end is not None and course.sizes is not None:
                contact = find_contact(course.end, course.sizes)
                if contact is not None:
                    contacts[campaign, course.index] = contact
        # Speeds are stored in single precision: what their rounding leaves is no behaviour.
        found[campaign, course.index] = np.round(accelerations, DECIMALS).astype(np.float32)
    return Motion(origin, durations_s.pop(), found, contacts) if len(durations_s) == 1 else None


def align_motion(failures: Aligned, motion: Motion) -> Floats | None:
    """Return the acceleration of the ego in each failure, shape (failures, steps). [m/s²]

    The result covers the last `WINDOW_S` before the collision, or all steps from the start. The
    acceleration of a failure without steps is 0. None if the motion in a failure is unknown, or
    does not fit its noise.
    """
    steps = failures.horizon
    if motion.origin == "collision":
        steps = min(steps, round(WINDOW_S / motion.step_s))
    alignment = ALIGNMENTS[motion.origin]
    aligned = np.zeros((len(failures.steps), steps), np.float32)
    keys = zip(failures.campaigns.tolist(), failures.episodes.tolist(), strict=True)
    for row, key, length in zip(aligned, keys, failures.steps.tolist(), strict=True):
        found, expected = motion.accelerations.get(key), min(length, steps)
        if found is None or len(found) != expected or not np.isfinite(found).all():
            return None
        row[alignment.place(expected, steps)] = found
    return aligned


def list_contacts(failures: Aligned, motion: Motion) -> tuple[Contact, ...]:
    """Return the contact in each failure; empty unless the contacts of all failures are known."""
    keys = zip(failures.campaigns.tolist(), failures.episodes.tolist(), strict=True)
    found = [contact for key in keys if (contact := motion.contacts.get(key))]
    return tuple(found) if len(found) == len(failures.steps) else ()


def mark_struck(contacts: Sequence[Contact]) -> Floats:
    """Return a column for each struck vehicle: 1 in failures that struck it, otherwise 0.

    Vehicles that few failures struck share a column; see `FEWEST_STRUCK`.

    Returns:
        Shape (failures, vehicles); no columns if all failures have the same vehicle.
    """
    counts = Counter(contact.struck for contact in contacts)
    least = max(FEWEST_STRUCK, LEAST_STRUCK * len(contacts))
    frequent = sorted(vehicle for vehicle, count in counts.items() if count >= least)
    struck = np.array([each.struck if each.struck in frequent else 0 for each in contacts])
    vehicles = np.unique(struck)
    if len(vehicles) < 2:
        return np.zeros((len(contacts), 0), np.float32)
    return np.asarray(struck[:, None] == vehicles, np.float32)


class GroupingFeatures(NamedTuple):
    """The data for grouping failures.

    Attributes:
        name: kind of the features.
        data: shape (failures, columns).
        components: number of principal components that are clustered.
        motion: source of the accelerations; None for other features.
        accelerations: acceleration in each failure, shape (failures, steps); None for other
            features. [m/s²]
        contacts: the vehicle that the ego hit in each failure; empty for other features, or if it
            is unknown.
    """

    name: Grouping
    data: Floats
    components: int
    motion: Motion | None = None
    accelerations: Floats | None = None
    contacts: tuple[Contact, ...] = ()

    @property
    def resolution(self) -> float:
        """Distance between scores below which failures count as equal."""
        if self.accelerations is None:
            return 0.0
        return RESOLUTION_MPS2 * sqrt(self.accelerations.shape[1])

    @property
    def has_struck(self) -> bool:
        """True if the data include the struck vehicles."""
        return self.accelerations is not None and self.data.shape != self.accelerations.shape

    def describe(
        self, space: "ComponentSpace", labels: NDArray[np.intp], order: NDArray[np.intp]
    ) -> Behaviour | None:
        """Return the ego's behaviour in each mode; None if failures are not grouped by behaviour.

        Args:
            space: principal components of the data.
            labels: mode of each failure, shape (failures,).
            order: order of the failures in the result.
        """
        motion, accelerations = self.motion, self.accelerations
        if motion is None or accelerations is None:
            return None
        steps = accelerations.shape[1]
        ends = np.arange(1, steps + 1) if motion.origin == "start" else np.arange(1 - steps, 1)
        times_s = ends * motion.step_s
        members = [np.flatnonzero(labels == label) for label in range(labels.max() + 1)]
        contacts = self.contacts
        collisions = describe_contacts(
            [[contacts[row] for row in rows if contacts] for rows in members]
        )
        return Behaviour(
            origin=motion.origin,
            times_s=times_s.astype(np.float32),
            explained=space.explained.astype(np.float32),
            scores=space.scores[order].astype(np.float32),
            modes=tuple(
                _describe_mode(accelerations[rows], times_s, motion, collision)
                for rows, collision in zip(members, collisions, strict=True)
            ),
            struck=tuple(contacts[row].struck for row in order.tolist()) if self.has_struck else (),
        )


def select_features(failures: Aligned, settings: AnalysisSettings) -> GroupingFeatures:
    """Return the features for grouping failures: noise if set, else the best that all have."""
    if settings.features == "noise":
        return GroupingFeatures("noise", failures.data, settings.components)
    motion = failures.motion
    accelerations = align_motion(failures, motion) if motion else None
    if motion and accelerations is not None:
        # All steps have one unit: divided by its own deviation, a step in which all failures are
        # nearly alike would count as much as the braking.
        smooth = smooth_accelerations(accelerations, motion.step_s)
        contacts = list_contacts(failures, motion)
        struck = mark_struck(contacts) if contacts else smooth[:, :0]
        # Rows of two different vehicles differ in two columns.
        weight = np.float32(STRUCK_MPS2 * sqrt(smooth.shape[1] / 2.0))
        data = np.hstack([smooth, weight * struck])
        components = COMPONENTS + max(struck.shape[1] - 1, 0)
        return GroupingFeatures("behaviour", data, components, motion, accelerations, contacts)
    if failures.step_s is None:
        return GroupingFeatures("noise", failures.data, settings.components)
    return GroupingFeatures("energy", compute_energy(failures, failures.step_s), COMPONENTS)


def smooth_accelerations(accelerations: Floats, step_s: float) -> Floats:
    """Return the moving mean over about `SMOOTHING_S`, shorter at both ends. [m/s²]

    The mean covers an odd number of steps, equally many before and after each step.

    Args:
        accelerations: shape (failures, steps). [m/s²]
        step_s: duration of a step. [s]
    """
    steps, half = accelerations.shape[1], max(0, round((SMOOTHING_S / step_s - 1.0) / 2.0))
    sums = np.pad(np.cumsum(accelerations, axis=1, dtype=np.float64), ((0, 0), (1, 0)))
    first = np.maximum(np.arange(steps) - half, 0)
    last = np.minimum(np.arange(steps) + half + 1, steps)
    return np.asarray((sums[:, last] - sums[:, first]) / (last - first), np.float32)


def compute_energy(failures: Aligned, step_s: float) -> Floats:
    """Return Σ (z² − 1) over windows of `ENERGY_S`, shape (failures, windows · columns).

    z² has the mean 1 under p(x). Steps that a failure does not reach count as 0. If failures are
    aligned at the collision, the windows end at the collision.

    Args:
        failures: aligned failures.
        step_s: duration of a step. [s]
    """
    length = max(1, round(ENERGY_S / step_s))
    windows = ceil(failures.horizon / length)
    missing = windows * length - failures.horizon
    # With the last step of a failure at the end, the window that is not full is the first one.
    ends_aligned = failures.alignment.place(1, failures.horizon).start > 0
    pad = (missing, 0) if ends_aligned else (0, missing)
    energies = np.zeros((len(failures.steps), windows, len(failures.columns)), np.float32)
    for first in range(0, len(energies), BLOCK):
        rows = slice(first, first + BLOCK)
        energy = np.square(failures.noise[rows][:, :, failures.columns].astype(np.float64)) - 1.0
        for row, steps in zip(energy, failures.steps[rows].tolist(), strict=True):
            place = failures.alignment.place(steps, failures.horizon)
            row[: place.start] = row[place.stop :] = 0.0
        padded = np.pad(energy, ((0, 0), pad, (0, 0)))
        energies[rows] = padded.reshape(len(energy), windows, length, -1).sum(axis=2)
    return energies.reshape(len(energies), -1)


def _describe_mode(
    accelerations: Floats, times_s: NDArray[np.float64], motion: Motion, collision: str
) -> ModeBehaviour:
    shown = min(len(accelerations), MOST_MEMBERS)
    places = np.arange(shown) * len(accelerations) // shown
    moved = describe_motion(accelerations, times_s, motion.step_s, motion.origin)
    return ModeBehaviour(
        mean=accelerations.mean(axis=0, dtype=np.float64).astype(np.float32),
        members=accelerations[places],
        words=f"{collision} {moved}".lstrip(),
    )


def describe_contacts(groups: Sequence[Sequence[Contact]]) -> tuple[str, ...]:
    """Return a sentence for each group of failures that names its most frequent contact.

    The sentences are empty if all groups have the same contact, or if no contacts are known.

    Args:
        groups: contacts in the failures of each group.
    """
    common = [Counter(group).most_common(1) for group in groups]
    if len({contact for found in common for contact, _ in found}) < 2:
        return ("",) * len(groups)
    sentences = []
    for group, ((contact, count),) in zip(groups, common, strict=True):
        some = "" if count == len(group) else f" in {count} of {len(group)} failures"
        struck = f"collides with vehicle {contact.struck}{some}"
        sentences.append(f"The {contact.side} of the ego {struck}.")
    return tuple(sentences)


def describe_motion(
    accelerations: Floats, times_s: NDArray[np.float64], step_s: float, origin: Origin
) -> str:
    """Return a sentence on how the ego brakes and accelerates in some failures.

    Strengths and times are medians over the failures. Braking lasts over the steps around the
    strongest braking that have at least half its strength.

    Args:
        accelerations: acceleration in each failure, shape (failures, steps). [m/s²]
        times_s: end of each step. [s]
        step_s: duration of a step. [s]
        origin: reference moment of the times.
    """
    braking_mps2, braking = _measure_effort(-accelerations, times_s, step_s, origin)
    raised_mps2, raised = _measure_effort(accelerations, times_s, step_s, origin)
    if braking_mps2 >= SLIGHT_MPS2:
        text = f"The ego brakes at up to {braking_mps2:.1f} m/s² {braking}"
    elif braking_mps2 >= FAINT_MPS2:
        text = f"The ego hardly brakes, at up to {braking_mps2:.1f} m/s²"
    else:
        text = "The ego does not brake"
    if raised_mps2 >= SLIGHT_MPS2:
        text += f", and accelerates at up to {raised_mps2:.1f} m/s² {raised}"
    return f"{text}."


def _measure_effort(
    strengths: Floats, times_s: NDArray[np.float64], step_s: float, origin: Origin
) -> tuple[float, str]:
    """Return the median of the failures' largest strengths, and the time span around them.

    Args:
        strengths: braking or acceleration in each failure, shape (failures, steps). [m/s²]
        times_s: end of each step. [s]
        step_s: duration of a step. [s]
        origin: reference moment of the times.
    """
    steps, largest = np.arange(strengths.shape[1]), strengths.max(axis=1)
    is_weak = strengths < 0.5 * largest[:, None]
    peaks = strengths.argmax(axis=1)[:, None]
    # An effort lasts from the last weak step before its strongest one to the first one after
    # it.
    before = np.where(is_weak & (steps < peaks), steps, -1).max(axis=1)
    after = np.where(is_weak & (steps > peaks), steps, len(steps)).min(axis=1)
    first, last = np.median(before + 1), np.median(after - 1)
    since_s, until_s = abs(times_s[round(first)] - step_s), abs(times_s[round(last)])
    event = "before the collision" if origin == "collision" else "after the start"
    return float(np.median(largest)), f"from {since_s:.1f} to {until_s:.1f} s {event}"
