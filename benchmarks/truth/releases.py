"""Figures: whether failure modes are recognised over releases of a planner.

Releases are made up. Each mode has a course of braking before the collision and a vehicle that is
struck; failures of it differ from that course by time, strength and noise, and their number is a
Poisson number. Each release's failures are grouped into modes as an analysis groups them, and the
modes of all releases are matched.

`releases.planted_f1`: modes come and go over ten releases; F1 of the statuses that are stated, over
all modes and releases, micro-averaged. `releases.false_new`: pairs of releases with the same modes;
share of the pairs in which anything is called first seen in the second one. `releases.false_gone`:
share of these pairs in which anything is called not found again.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from benchmarks.episode_pool import EpisodePool
from benchmarks.figures import Figure
from benchmarks.samples import COMMAND, share
from numpy.typing import NDArray

from eigenfail.values.arrays import Floats
from eigenfail.values.release import ModeStatus
from eigenfail_services.analysis.behaviour import (
    COMPONENTS,
    RESOLUTION_MPS2,
    STRUCK_MPS2,
    mark_struck,
    smooth_accelerations,
)
from eigenfail_services.analysis.clusters import CLUSTERERS, divide
from eigenfail_services.analysis.components import fit_components
from eigenfail_services.analysis.footprints import Contact
from eigenfail_services.analysis.mode_matching import ReleaseBehaviours, match_modes
from eigenfail_services.analysis.mode_regions import ModeBehaviours

PAIRS = 200
HISTORIES = 40
RELEASES = 10
MODES = (2, 6)
STEPS, STEP_S = 45, 0.1
EPISODES = 2_000
FAILURES = (12.0, 120.0)
"""Mean numbers of failures of a mode in a release."""

RARE = (0.5, 120.0)
"""The same in pairs of releases, where modes may be too rare to be found in both."""

VEHICLES = 3
ONSET_S, LENGTH_S, STRENGTH_MPS2 = (0.5, 4.0), (0.8, 3.0), (1.0, 8.0)
SHIFT_S, CHANGE, NOISE_MPS2 = 0.15, 0.10, 0.3
"""Standard deviations within a mode: of the time, of the strength (relative), and of each step."""

APART_MPS2 = 3.0
"""Least root mean square difference between the courses of two modes that strike one vehicle."""

SAMPLED = 40
"""Failures of a mode that are compared at most."""


class PlantedMode(NamedTuple):
    """A mode that is made up.

    Attributes:
        onset_s: start of the braking before the collision. [s]
        length_s: duration of the braking. [s]
        strength_mps2: deceleration. [m/s²]
        struck: number of the vehicle that is struck.
        failures: mean number of failures in a release that has it.
    """

    onset_s: float
    length_s: float
    strength_mps2: float
    struck: int
    failures: float


class Drawn(NamedTuple):
    """The failures of a release, and the planted mode of each of its modes' majority."""

    behaviours: ReleaseBehaviours
    planted: tuple[int, ...]


def find_figures(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """How well statuses agree with the truth, and how often a re-run differs."""
    pairs = pool.each(compare_rerun, range(seed, seed + PAIRS))
    note = f"{MODES[0]} to {MODES[1]} modes with {RARE[0]:g} to {RARE[1]:g} failures in {EPISODES}"
    yield "releases.false_new", share([ModeStatus.FIRST_SEEN in each for each in pairs], note)
    gone = [ModeStatus.NOT_FOUND_AGAIN in each for each in pairs]
    yield "releases.false_gone", share(gone, note)
    counts = pool.each(score_history, range(seed, seed + HISTORIES))
    hits, stated, true = (sum(each[place] for each in counts) for place in range(3))
    note = f"{HISTORIES} histories of {RELEASES} releases; {true:,} statuses; {stated:,} stated"
    value = 2.0 * hits / (stated + true)
    yield (
        "releases.planted_f1",
        Figure(value=value, unit="F1", n=HISTORIES, note=note, command=COMMAND),
    )


def compare_rerun(seed: int) -> tuple[ModeStatus | None, ...]:
    """Return the statuses in the second of two releases that have the same modes."""
    generator = np.random.default_rng([seed, 221])
    modes = make_modes(generator, RARE)
    pair = [draw_release(generator, modes, range(len(modes))).behaviours for _ in range(2)]
    return tuple(each[-1].status for each in match_modes(pair, STEP_S))


def score_history(seed: int) -> tuple[int, int, int]:
    """Return how many statuses of ten releases are right, how many are stated, and how many true.

    A mode that is recognised belongs to the planted mode of most of its failures.
    """
    generator = np.random.default_rng([seed, 222])
    modes = make_modes(generator, FAILURES)
    present = generator.random((RELEASES, len(modes))) < 0.5
    for place in np.flatnonzero(~present.any(axis=1)):
        present[place, generator.integers(len(modes))] = True
    drawn = [draw_release(generator, modes, np.flatnonzero(each).tolist()) for each in present]
    stated = Counter(list_stated(drawn))
    true = Counter(list_true(present))
    return (stated & true).total(), stated.total(), true.total()


def list_true(present: NDArray[np.bool_]) -> Iterator[tuple[int, int, ModeStatus]]:
    """Yield planted mode, release and status, from the first release that has the mode on."""
    for mode, column in enumerate(present.T):
        first = int(column.argmax())
        if not column[first]:
            continue
        yield mode, first, ModeStatus.FIRST_SEEN
        for place in range(first + 1, len(column)):
            before, now = column[place - 1], column[place]
            returned = ModeStatus.STILL_THERE if before else ModeStatus.REGRESSED
            yield mode, place, returned if now else ModeStatus.NOT_FOUND_AGAIN


def list_stated(drawn: Sequence[Drawn]) -> Iterator[tuple[int, int, ModeStatus]]:
    """Yield the same as stated; what is undecided is not stated."""
    for sightings in match_modes([each.behaviours for each in drawn], STEP_S):
        votes = Counter[int]()
        for release, each in zip(drawn, sightings, strict=True):
            if each.source is not None:
                votes[release.planted[each.source]] += each.failures
        ((mode, _),) = votes.most_common(1)
        for place, each in enumerate(sightings):
            if each.status not in (None, ModeStatus.UNDECIDED):
                yield mode, place, each.status


def make_modes(
    generator: np.random.Generator, failures: tuple[float, float]
) -> tuple[PlantedMode, ...]:
    """Return modes that differ from each other by at least `APART_MPS2` or by what is struck."""
    modes = list[PlantedMode]()
    wanted = int(generator.integers(MODES[0], MODES[1] + 1))
    while len(modes) < wanted:
        drawn = PlantedMode(
            onset_s=float(generator.uniform(*ONSET_S)),
            length_s=float(generator.uniform(*LENGTH_S)),
            strength_mps2=float(generator.uniform(*STRENGTH_MPS2)),
            struck=int(generator.integers(1, VEHICLES + 1)),
            failures=float(np.exp(generator.uniform(*np.log(failures)))),
        )
        if all(is_apart(drawn, each) for each in modes):
            modes.append(drawn)
    return tuple(modes)


def is_apart(one: PlantedMode, other: PlantedMode) -> bool:
    """Whether two modes differ enough to be told apart."""
    shapes = [make_course(each, 0.0, 1.0)[None].astype(np.float32) for each in (one, other)]
    smooth = [smooth_accelerations(each, STEP_S) for each in shapes]
    difference_mps2 = float(np.sqrt(np.square(smooth[0] - smooth[1]).mean()))
    return one.struck != other.struck or difference_mps2 >= APART_MPS2


def make_course(mode: PlantedMode, shift_s: float, factor: float) -> NDArray[np.float64]:
    """Return the acceleration at each step before the collision, shape (steps,). [m/s²]"""
    times_s = (np.arange(STEPS) - STEPS + 0.5) * STEP_S
    begin_s = -mode.onset_s + shift_s
    brakes = (times_s >= begin_s) & (times_s < begin_s + mode.length_s)
    return np.where(brakes, -factor * mode.strength_mps2, 0.0)


def draw_release(
    generator: np.random.Generator, modes: Sequence[PlantedMode], present: Sequence[int]
) -> Drawn:
    """Return the failures of a release in the groups that an analysis finds among them."""
    owners = [
        place
        for place in present
        for _ in range(max(0, int(generator.poisson(modes[place].failures))))
    ]
    if not owners:
        return Drawn(ReleaseBehaviours(EPISODES, True, ()), ())
    accelerations = np.stack([draw_failure(generator, modes[each]) for each in owners])
    contacts = [Contact(modes[each].struck, "front") for each in owners]
    labels = group_failures(accelerations, contacts)
    groups, planted = list[ModeBehaviours](), list[int]()
    for label in range(labels.max() + 1):
        rows = np.flatnonzero(labels == label)
        shown = rows[np.arange(min(len(rows), SAMPLED)) * len(rows) // min(len(rows), SAMPLED)]
        struck = tuple(contacts[row].struck for row in shown)
        groups.append(ModeBehaviours(accelerations[shown], struck, len(rows)))
        planted.append(Counter(owners[row] for row in rows).most_common(1)[0][0])
    return Drawn(ReleaseBehaviours(EPISODES, True, tuple(groups)), tuple(planted))


def draw_failure(generator: np.random.Generator, mode: PlantedMode) -> Floats:
    """Return the acceleration in a failure of a mode, shape (steps,). [m/s²]"""
    shift_s = SHIFT_S * generator.standard_normal()
    factor = 1.0 + CHANGE * generator.standard_normal()
    noise = NOISE_MPS2 * generator.standard_normal(STEPS)
    return (make_course(mode, shift_s, factor) + noise).astype(np.float32)


def group_failures(accelerations: Floats, contacts: Sequence[Contact]) -> NDArray[np.intp]:
    """Return the group of each failure, as an analysis of the behaviour with defaults finds it."""
    smooth = smooth_accelerations(accelerations, STEP_S)
    struck = mark_struck(contacts)
    weight = np.float32(STRUCK_MPS2 * np.sqrt(STEPS / 2.0))
    space = fit_components(
        np.hstack([smooth, weight * struck]), COMPONENTS + max(struck.shape[1] - 1, 0)
    )
    resolution = float(RESOLUTION_MPS2 * np.sqrt(STEPS))
    return divide(space.scores, None, CLUSTERERS["kmeans"], resolution).labels
