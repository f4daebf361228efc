"""Match the failure modes of several releases, and judge how each mode changed.

Failures of a release belong to a mode of earlier releases if they lie within the mode's radius,
which a bootstrap over its failures estimates. A mode is new, or not found again, if chance is
unlikely to explain the numbers of failures. The test is the conditional test of two Poisson rates
(Przyborowski and Wilenski 1940), at a level that holds over all modes of a release together
(Bonferroni).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenfail.values.release import ModeStatus
from eigenfail_services.analysis import mode_regions

LEVEL = 0.05
"""Probability that anything in a release is called other than before though nothing changed."""

MAJORITY = 0.5
"""Share of the failures of a mode that decides to which earlier mode it belongs."""

MOST_KEPT = 200
"""Failures that are kept of a mode over releases."""


class ReleaseBehaviours(NamedTuple):
    """The failure modes of a release.

    Attributes:
        episodes: number of completed episodes.
        is_random: whether the episodes were drawn from p(x), so that failures can be counted. It is
            the same for all compared releases, as they have one method.
        modes: the modes of its analyses.
        build: text that is equal for releases of the same code and settings; empty if code and
            settings are unknown.
        noise: text that is equal for releases whose episodes had the same noise; empty if the noise
            is unique.
    """

    episodes: int
    is_random: bool
    modes: tuple[mode_regions.ModeBehaviours, ...]
    build: str = ""
    noise: str = ""


class Sighting(NamedTuple):
    """A mode in a release.

    Attributes:
        status: status of the mode; None in releases before the mode was found.
        failures: number of failures that belong to the mode.
        chance: probability that such a difference arises by chance, for all modes together; None
            without a comparison.
        source: place of the release's mode with the largest share of the failures; None without
            failures.
        same_as: place of an earlier release of the same build, if it contradicts a change and the
            mode is therefore undecided; otherwise None.
    """

    status: ModeStatus | None
    failures: int = 0
    chance: float | None = None
    source: int | None = None
    same_as: int | None = None


Sightings = tuple[Sighting, ...]


class _Known:
    """A mode of earlier releases: its failures, and the numbers that the tests compare.

    Releases with the same noise, such as campaigns with the same seeds, are one sample. Only the
    newest of them counts.
    """

    def __init__(self, points: mode_regions.Points) -> None:
        self.points = points
        self.spread = mode_regions.measure_spread(points)
        self.sightings: list[Sighting] = []
        self.present: dict[str, tuple[float, int]] = {}
        self.without: dict[str, int] = {}
        self.is_absent = False

    @property
    def failures(self) -> float:
        """Number of failures in the releases that have the mode."""
        return sum(failures for failures, _ in self.present.values())

    @property
    def episodes_with(self) -> int:
        """Number of episodes in the releases that have the mode."""
        return sum(episodes for _, episodes in self.present.values())

    @property
    def episodes_without(self) -> int:
        """Number of episodes in the releases since then, which do not have the mode."""
        return sum(self.without.values())

    def keep(self, points: mode_regions.Points) -> None:
        """Add failures, and keep at most `MOST_KEPT`, evenly spaced."""
        # A bound for a long history of releases; evenly spaced, so that none of them is favoured.
        merged = np.concatenate([self.points, points])
        kept = min(len(merged), MOST_KEPT)
        self.points = merged[np.arange(kept) * len(merged) // kept]
        self.spread = mode_regions.measure_spread(self.points)


def match_modes(releases: Sequence[ReleaseBehaviours], step_s: float) -> tuple[Sightings, ...]:
    """Return the sightings of each mode by release, with the modes in the order of their discovery.

    All modes of the first release are first seen in it. If earlier releases have the same build,
    changes are checked against the newest of them: the planner is unchanged and has the same modes.

    Args:
        releases: the releases, oldest first.
        step_s: duration of a step. [s]
    """
    known: list[_Known] = []
    earlier: dict[str, int] = {}
    builds: dict[str, int] = {}
    for place, (release, clouds) in enumerate(
        zip(
            releases,
            mode_regions.list_clouds([each.modes for each in releases], step_s),
            strict=True,
        )
    ):
        # By noise: releases with the same noise replace each other, as they are one sample.
        before = sum(earlier.values())
        _Comparison(place, release, known, before, builds.get(release.build)).run(
            mode_regions.separate_failures(clouds, release.modes)
        )
        earlier[release.noise or f"release {place}"] = release.episodes
        if release.build:
            builds[release.build] = place
    return tuple(tuple(each.sightings) for each in known)


class _Comparison:
    """Compares a release with the modes of earlier releases.

    Args:
        place: number of the release, from 0.
        release: the release.
        known: modes of earlier releases; new modes of this release are added.
        earlier: number of episodes of earlier releases.
        same_as: place of the newest earlier release of the same build; None without one.
    """

    def __init__(
        self,
        place: int,
        release: ReleaseBehaviours,
        known: list[_Known],
        earlier: int,
        same_as: int | None,
    ) -> None:
        self._place = place
        self._release = release
        self._known = known
        self._earlier = earlier
        self._noise = release.noise or f"release {place}"
        self._same_as = same_as

    def run(self, pieces: Sequence[mode_regions.FailureGroup]) -> None:
        """Add a sighting to each known mode, and add the modes that are new."""
        spreads = [mode_regions.measure_spread(each.points) for each in pieces]
        usual = mode_regions.find_usual_radius([*(each.spread for each in self._known), *spreads])
        regions = [
            mode_regions.find_region(each.points, each.spread, usual) for each in self._known
        ]
        # A copy: modes that this release begins are not to be matched with its own failures.
        old = [*self._known]
        shares = np.zeros((len(pieces), len(old)))
        left = list[mode_regions.FailureGroup]()
        for row, (piece, spread) in enumerate(zip(pieces, spreads, strict=True)):
            region = mode_regions.find_region(piece.points, spread, usual)
            owners = self._assign(piece.points, region, regions)
            if owners is None:
                left.append(piece)
                continue
            for owner in np.unique(owners):
                mine = piece.points[owners == owner]
                shares[row, owner] = piece.failures * len(mine) / len(piece.points)
                old[owner].keep(mine)
        # After all failures: a mode is fixed only if no piece of this release has a share in it.
        for each, column in zip(old, shares.T, strict=True):
            each.sightings.append(self._see(each, column, pieces))
        self._known.extend(self._begin(piece, len(pieces)) for piece in left)

    def _assign(
        self,
        points: mode_regions.Points,
        region: mode_regions.ModeRegion,
        regions: Sequence[mode_regions.ModeRegion],
    ) -> NDArray[np.intp] | None:
        """Return the earlier mode of each failure; None if the mode is a new one.

        Args:
            points: failures of a mode of this release.
            region: region of that mode.
            regions: regions of the modes of earlier releases.
        """
        if not regions:
            return None
        distances = np.stack([each.measure(points) for each in regions], axis=1)
        inside = distances <= [each.radius for each in regions]
        nearest = np.where(inside, distances, np.inf).argmin(axis=1)
        if inside.any(axis=1).mean() <= MAJORITY:
            # A mode of an earlier release may be a part of this one.
            parts = [
                float((region.measure(each.points) <= region.radius).mean()) for each in self._known
            ]
            if max(parts) <= MAJORITY:
                return None
            within = np.array(parts) > MAJORITY
            nearest = np.where(inside | within, distances, np.inf).argmin(axis=1)
        # Failures on the border to another mode stay with the others of their own.
        main = np.bincount(nearest).argmax()
        stays = inside[:, main] | ~inside.any(axis=1)
        return np.where(stays, main, nearest)

    def _see(
        self, mode: _Known, shares: mode_regions.Points, pieces: Sequence[mode_regions.FailureGroup]
    ) -> Sighting:
        failures = round(float(shares.sum()))
        if failures:
            return self._see_present(mode, failures, pieces[int(shares.argmax())].source)
        return self._see_absent(mode)

    def _see_present(self, mode: _Known, failures: int, source: int) -> Sighting:
        status, chance, same_as = ModeStatus.STILL_THERE, None, None
        if mode.is_absent:
            chance = self._correct_chance(failures, self._release.episodes, mode.episodes_without)
            same_as = self._find_contradiction(mode, is_present=True)
            is_back = chance <= LEVEL and same_as is None
            status = ModeStatus.REGRESSED if is_back else ModeStatus.UNDECIDED
            mode.present = {}
        mode.present |= {noise: (0.0, episodes) for noise, episodes in mode.without.items()}
        mode.present[self._noise] = failures, self._release.episodes
        mode.without, mode.is_absent = {}, False
        return Sighting(status, failures, chance, source, same_as)

    def _see_absent(self, mode: _Known) -> Sighting:
        mode.without[self._noise] = self._release.episodes
        same_as = self._find_contradiction(mode, is_present=False)
        if same_as is not None:
            return Sighting(ModeStatus.UNDECIDED, same_as=same_as)
        if not self._release.is_random:
            mode.is_absent = True
            return Sighting(ModeStatus.NOT_MET)
        if mode.is_absent:
            return Sighting(ModeStatus.NOT_FOUND_AGAIN)
        chance = self._correct_chance(mode.failures, mode.episodes_with, mode.episodes_without)
        mode.is_absent = chance <= LEVEL
        status = ModeStatus.NOT_FOUND_AGAIN if mode.is_absent else ModeStatus.UNDECIDED
        return Sighting(status, 0, chance)

    def _find_contradiction(self, mode: _Known, is_present: bool) -> int | None:
        """Return the release of the same build if only one of both releases has the mode."""
        if self._same_as is None:
            return None
        was_present = bool(mode.sightings[self._same_as].failures)
        return self._same_as if was_present != is_present else None

    def _begin(self, piece: mode_regions.FailureGroup, together: int) -> _Known:
        failures, mode = round(piece.failures), _Known(piece.points)
        mode.present[self._noise] = failures, self._release.episodes
        mode.sightings = [Sighting(None)] * self._place
        status, chance = ModeStatus.FIRST_SEEN, None
        if self._place:
            chance = min(
                1.0, together * self._test(failures, self._release.episodes, self._earlier)
            )
            is_new = chance <= LEVEL and self._same_as is None
            status = ModeStatus.FIRST_SEEN if is_new else ModeStatus.UNDECIDED
        mode.sightings.append(Sighting(status, failures, chance, piece.source, self._same_as))
        return mode

    def _correct_chance(self, failures: float, episodes: int, without: int) -> float:
        return min(1.0, len(self._known) * self._test(failures, episodes, without))

    def _test(self, failures: float, episodes: int, without: int) -> float:
        """Return the probability that all failures are on one side, if both have one rate.

        One side has `episodes` and all failures, the second side has `without` episodes and no
        failures. The result is 1 if the episodes are not a random sample.
        """
        if not self._release.is_random or not episodes or not without:
            return 1.0
        return float((episodes / (episodes + without)) ** failures)
