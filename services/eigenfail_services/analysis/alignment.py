"""Align the noise of failures of different length at the start or at the collision."""

import hashlib
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.values.analysis import JOINT, AnalysisSettings, InfluenceShare, Moment
from eigenfail.values.arrays import Floats
from eigenfail.values.channels import EVERY, VEHICLE, split_name
from eigenfail.values.disturbance import AXES
from eigenfail.values.records import Failures
from eigenfail_services.analysis.footprints import Contact

BLOCK = 4096
"""Number of rows that are converted to double precision at a time."""


class Alignment(Protocol):
    """Placement of an episode within the horizon."""

    def place(self, steps: int, horizon: int) -> slice:
        """Return the rows that an episode of n steps fills; the others hold no noise."""

    def reference(self, steps: Sequence[int], horizon: int) -> int:
        """Return one number of steps that represents all given episodes."""


class AtStart:
    """Aligns first steps; rows after the collision hold no noise."""

    def place(self, steps: int, _horizon: int) -> slice:
        """Return the rows from the first one on."""
        return slice(0, steps)

    def reference(self, _steps: Sequence[int], horizon: int) -> int:
        """Return the horizon: nothing moves on the way back."""
        return horizon


class AtCollision:
    """Aligns collisions: a row is a time before the impact."""

    def place(self, steps: int, horizon: int) -> slice:
        """Return the rows up to the last one."""
        return slice(horizon - steps, horizon)

    def reference(self, steps: Sequence[int], _horizon: int) -> int:
        """Return the median (longer of two middle ones): the impact comes at its usual time."""
        return median_steps(steps)


ALIGNMENTS: dict[str, Alignment] = {"start": AtStart(), "collision": AtCollision()}


def choose_columns(axes: str, channels: Sequence[str]) -> tuple[int, ...]:
    """Return the columns of z that are analysed.

    Args:
        axes: as in the settings: `joint`, the name of a channel, or a name such as `every.lateral`
            for that quantity of all vehicles.
        channels: the names of all columns.

    Raises:
        UnknownName: the channel does not exist.
    """
    groups = {JOINT: tuple(range(len(channels))), **_group_vehicles(channels)}
    chosen = groups | {name: (column,) for column, name in enumerate(channels)}
    if axes not in chosen:
        raise UnknownName("axes", axes, chosen)
    return chosen[axes]


def _group_vehicles(channels: Sequence[str]) -> dict[str, tuple[int, ...]]:
    """Return the columns of each quantity of numbered vehicles, by the name of the group."""
    groups: dict[str, tuple[int, ...]] = {}
    for column, (target, quantity) in enumerate(map(split_name, channels)):
        if target.startswith(VEHICLE):
            name = f"{EVERY}.{quantity}"
            groups[name] = (*groups.get(name, ()), column)
    return groups


def median_steps(steps: Sequence[int]) -> int:
    """Return the median length of some episodes (the longer of two middle lengths)."""
    return int(np.quantile(steps, 0.5, method="higher"))


class Motion(NamedTuple):
    """The acceleration of the ego in failures, and the vehicles that it hit.

    Attributes:
        origin: `collision` if only the last steps of each failure count, `start` if all steps
            count.
        step_s: duration of a step. [s]
        accelerations: acceleration in the steps that count, by campaign and index of the episode.
            [m/s²]
        contacts: the vehicle that the ego hit, by the same keys, for the failures with a known
            contact.
    """

    origin: Literal["collision", "start"]
    step_s: float
    accelerations: Mapping[tuple[int, int], Floats]
    contacts: Mapping[tuple[int, int], Contact]


class Aligned(NamedTuple):
    """Failures in one array, aligned with each other.

    Attributes:
        campaigns: id of the campaign of each, shape (failures,).
        episodes: index of each episode in its campaign, shape (failures,).
        steps: length of each, shape (failures,).
        noise: z, shape (failures, horizon, channels). [sigma]
        alignment: how the failures were aligned.
        columns: analysed columns of z.
        channels: the names of all columns of z.
        motion: motion of the ego in these failures and possibly in others; None if unknown.
        step_s: duration of a step; None if it does not exist or is unknown. [s]
    """

    campaigns: NDArray[np.int64]
    episodes: NDArray[np.int64]
    steps: NDArray[np.int64]
    noise: Floats
    alignment: Alignment
    columns: tuple[int, ...]
    channels: tuple[str, ...] = AXES
    motion: Motion | None = None
    step_s: float | None = None

    @property
    def horizon(self) -> int:
        """Number of steps of a full episode."""
        return int(self.noise.shape[1])

    @property
    def data(self) -> Floats:
        """D, with one row for each failure, shape (failures, horizon · columns)."""
        if len(self.columns) == len(self.channels):
            return self.noise.reshape(len(self.noise), -1)
        return np.ascontiguousarray(self.noise[:, :, self.columns]).reshape(len(self.noise), -1)

    def take(self, rows: NDArray[np.intp]) -> "Aligned":
        """Return the failures in some rows."""
        return self._replace(
            campaigns=self.campaigns[rows],
            episodes=self.episodes[rows],
            steps=self.steps[rows],
            noise=self.noise[rows],
        )

    @property
    def order(self) -> NDArray[np.intp]:
        """Order of the rows by campaign and episode."""
        return np.lexsort((self.episodes, self.campaigns))

    def by_step(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """Reshape rows of D to (rows, horizon, channels); channels left out are zero."""
        placed = np.zeros((len(rows), self.horizon, len(self.channels)))
        placed[:, :, self.columns] = rows.reshape(len(rows), self.horizon, len(self.columns))
        return placed

    def injectable(
        self, noise: NDArray[np.float64], members: NDArray[np.intp]
    ) -> NDArray[np.float64]:
        """Return z: noise of `members`, moved back to the start. Both have (horizon, channels)."""
        steps = self.alignment.reference(self.steps[members].tolist(), self.horizon)
        z = np.zeros((self.horizon, len(self.channels)))
        z[:steps] = noise[self.alignment.place(steps, self.horizon)]
        return z

    def at_collision(self) -> "Aligned":
        """Return the same failures, aligned at the collision."""
        there = ALIGNMENTS["collision"]
        if self.alignment is there:
            return self
        noise = np.zeros_like(self.noise)
        for row, z, steps in zip(noise, self.noise, self.steps.tolist(), strict=True):
            from_ = self.alignment.place(steps, self.horizon)
            row[there.place(steps, self.horizon)] = z[from_]
        return self._replace(noise=noise, alignment=there)

    def runs(self) -> Iterator[NDArray[np.float64]]:
        """Yield the noise without padding, in blocks of failures of one length.

        The shape of a block is (rows, length of its failures, channels).
        """
        # Failures of one length make an array without gaps.
        for steps in np.unique(self.steps).tolist():
            rows = np.flatnonzero(self.steps == steps)
            place = self.alignment.place(steps, self.horizon)
            for first in range(0, len(rows), BLOCK):
                yield self.noise[rows[first : first + BLOCK], place].astype(np.float64)


def check_clusterer(settings: AnalysisSettings) -> None:
    """Raise InvalidValue if a number of groups is set that the clusterer would ignore."""
    if settings.clusters is not None and settings.clusterer == "hdbscan":
        problem = "hdbscan finds the number of modes itself."
        raise InvalidValue("clusters", problem, "Leave it out, or take clusterer kmeans.")


def check_noise(z: Floats, index: int, horizon: int, channels: int) -> None:
    """Raise InvalidValue unless noise is finite, with shape (at most `horizon`, `channels`)."""
    if z.ndim != 2 or z.shape[1] != channels or len(z) > horizon or not np.isfinite(z).all():
        shape = f"(at most {horizon}, {channels})"
        raise InvalidValue(
            "failures",
            f"the noise of episode {index} is not finite of shape {shape}.",
            "Analyse campaigns of one horizon, and check the store that it came from.",
        )


def explain_no_failures() -> InvalidValue:
    """Return the error for an analysis without failures."""
    return InvalidValue(
        "failures",
        "there is none to analyse.",
        "Where episodes errored, correct what raised and launch the campaign again. Otherwise give "
        "it a larger budget, or use a method that searches for failures: ast, cem, difs, subset.",
    )


class FailureBatch(NamedTuple):
    """Some failures of a campaign."""

    campaign: int
    failures: Failures


class _PlacedBatch(NamedTuple):
    """Aligned failures of one campaign, and the key that each failure is sorted by."""

    keys: list[tuple[bytes, int, int]]
    steps: list[int]
    noise: Floats


def gather_failures(
    portions: Iterable[FailureBatch],
    horizon: int,
    settings: AnalysisSettings,
    channels: tuple[str, ...] = AXES,
) -> Aligned:
    """Align failures, in an order that depends only on their noise.

    So modes do not depend on when a failure was found, and sums are rounded in the same way.

    Args:
        portions: batches of failures without common episodes.
        horizon: steps of a full episode.
        settings: how to align, and which channels.
        channels: the names of the columns of z.

    Raises:
        UnknownName: the settings name a channel that does not exist.
        InvalidValue: failures are missing, or one does not fit the horizon and the channels.
    """
    columns = choose_columns(settings.axes, channels)
    shape = (horizon, len(channels))
    parts = [_place_batch(portion, shape, settings.align) for portion in portions]
    keys = [key for part in parts for key in part.keys]
    if not keys:
        raise explain_no_failures()
    # A key begins with a hash of the noise; campaign and index only order equal noise.
    order = sorted(range(len(keys)), key=keys.__getitem__)
    _, campaigns, episodes = zip(*(keys[row] for row in order), strict=True)
    steps = np.array([steps for part in parts for steps in part.steps])
    noise = np.concatenate([part.noise for part in parts])
    # All noise is in one array now; the parts would double the memory.
    del parts
    return Aligned(
        campaigns=np.array(campaigns),
        episodes=np.array(episodes),
        steps=steps[order],
        noise=noise[order],
        alignment=ALIGNMENTS[settings.align],
        columns=columns,
        channels=channels,
    )


def select_latest(failures: Aligned, campaigns: Collection[int]) -> Aligned:
    """Return the failures without the earlier half of some campaigns' failures.

    If a campaign has an odd number of failures, the middle failure is kept.

    Args:
        failures: failures of one or several campaigns.
        campaigns: ids of the campaigns that keep only their latest half.
    """
    kept = np.ones(len(failures.episodes), np.bool_)
    for campaign in campaigns:
        # Rows are in the order of the noise; "latest" is by the number of the episode.
        own = np.flatnonzero(failures.campaigns == campaign)
        in_time = own[np.argsort(failures.episodes[own])]
        kept[in_time[: len(own) // 2]] = False
    return failures if kept.all() else failures.take(np.flatnonzero(kept))


def select_samples(failures: Aligned, first_samples: Mapping[int, int]) -> Aligned:
    """Return the failures without each campaign's failures before its first sample.

    Args:
        failures: failures of one or several campaigns.
        first_samples: index of the first sample, by id of a campaign. A campaign without failures
            from this index on keeps all its failures.
    """
    kept = np.ones(len(failures.episodes), np.bool_)
    for campaign, first in first_samples.items():
        early = (failures.campaigns == campaign) & (failures.episodes < first)
        if (late := (failures.campaigns == campaign) & ~early).any():
            kept &= late | (failures.campaigns != campaign)
    return failures if kept.all() else failures.take(np.flatnonzero(kept))


class EarlyFailures(NamedTuple):
    """Failures that an analysis of the latest failures leaves out.

    Attributes:
        learning: ids of the campaigns whose earlier half does not count.
        first_samples: index of the first failure that counts, by id of a campaign.
    """

    learning: Collection[int]
    first_samples: Mapping[int, int]

    def leave_out(self, failures: Aligned) -> Aligned:
        """Return the failures without the early ones."""
        return select_samples(select_latest(failures, self.learning), self.first_samples)


NONE_EARLY = EarlyFailures((), {})


def _place_batch(portion: FailureBatch, shape: tuple[int, int], how: str) -> _PlacedBatch:
    """Align the failures of one campaign.

    Args:
        portion: failures of one campaign.
        shape: steps of a full episode, and channels.
        how: a name in `ALIGNMENTS`.

    Raises:
        InvalidValue: the noise of a failure does not fit the shape.
    """
    campaign, failures = portion
    noise = np.zeros((len(failures.noise), *shape), np.float32)
    for row, z, index in zip(noise, failures.noise, failures.indices, strict=True):
        check_noise(z, index, *shape)
        row[ALIGNMENTS[how].place(len(z), shape[0])] = z
    keys = [
        (hashlib.blake2b(z.tobytes(), digest_size=16).digest(), campaign, index)
        for z, index in zip(failures.noise, failures.indices, strict=True)
    ]
    return _PlacedBatch(keys, [len(z) for z in failures.noise], noise)


MAX_MOMENTS = 3


MIN_STEPS_APART = 5
"""Steps that two moments of a channel are apart at least: nearer ones are one moment."""


LAST_S = (1.0, 2.0)


def find_moments(influence: Floats, failures: Aligned, step_s: float | None) -> tuple[Moment, ...]:
    """Return the steps of greatest influence in each channel, the greatest first.

    Only steps that half of the failures reach count: steps that few reach say little.

    Args:
        influence: shape (steps, channels), in the alignment of the failures.
        failures: analysed failures.
        step_s: duration of a step; None if steps are not timed. [s]
    """
    steps = median_steps(failures.steps.tolist())
    place = failures.alignment.place(steps, failures.horizon)
    return tuple(
        Moment(
            axis=axis,
            step=place.start + peak,
            # In doubles 3 · 0.1 is 0.30000000000000004.
            before_collision_s=None if step_s is None else round((steps - peak) * step_s, 9),
            influence=float(course[peak]),
        )
        for axis, course in zip(failures.channels, influence[place].T, strict=True)
        for peak in find_peaks(course.tolist())
    )


def find_peaks(course: Sequence[float]) -> list[int]:
    """Return the positions of a course's largest values, kept apart, the largest first."""
    found: list[int] = []
    for step in sorted(range(len(course)), key=lambda step: (-course[step], step)):
        if len(found) == MAX_MOMENTS or course[step] <= 0.0:
            break
        if all(abs(step - other) >= MIN_STEPS_APART for other in found):
            found.append(step)
    return found


def measure_before_collision(
    influence: Floats, steps: int, step_s: float | None, channels: tuple[str, ...] = AXES
) -> tuple[InfluenceShare, ...]:
    """Return the share of the influence in the last seconds before the collision.

    Args:
        influence: shape (horizon, channels); the last row is the step before the collision.
        steps: number of last rows that count as the time before the collision.
        step_s: duration of a step; None, which gives an empty result, if steps are not timed. [s]
        channels: the names of the columns.
    """
    if step_s is None:
        return ()
    course = influence[len(influence) - steps :].astype(np.float64)
    lasts = ((seconds, round(seconds / step_s)) for seconds in LAST_S)
    return tuple(
        InfluenceShare(
            seconds=seconds,
            time=last / steps,
            both=_compute_share(course, last),
            **_name_shares(
                tuple(
                    _compute_share(course[:, way : way + 1], last) for way in range(len(channels))
                ),
                channels,
            ),
        )
        for seconds, last in lasts
        if 0 < last <= steps
    )


def _name_shares(shares: tuple[float | None, ...], channels: tuple[str, ...]) -> dict[str, Any]:
    # The two channels of a road have fields of their own, by which results were always stored.
    if channels == AXES:
        return dict(zip(AXES, shares, strict=True))
    return {**dict.fromkeys(AXES), "channels": shares}


def _compute_share(course: NDArray[np.float64], last: int) -> float | None:
    """Return the share of the last rows in the sum of all rows; None if the sum is 0."""
    total = float(course.sum())
    return float(course[-last:].sum()) / total if total > 0.0 else None
