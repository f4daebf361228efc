"""The campaigns of a report whose failures were analysed, and the members of their modes."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenfail.contracts import Store
from eigenfail.errors import InputError
from eigenfail.values import Analysis, AnalysisResult, CampaignSpec, EpisodeResult, Floats
from eigenfail_services.campaigns.analysed import step_s
from eigenfail_services.reports.material import Material, Subject
from eigenfail_services.reports.samples import evenly

MOST_MEMBERS = 300
MOST_MODES = 4
"""How many modes of a campaign are drawn; the tables have all."""


class Analysed(NamedTuple):
    """A campaign with what PCA and clustering found in its failures.

    Attributes:
        medoids: the real failure nearest to each mode's centre, in the order of the modes.
        step_s: time of a step [s]; None where steps have none.
    """

    subject: Subject
    analysis: Analysis
    result: AnalysisResult
    medoids: tuple[EpisodeResult, ...]
    step_s: float | None

    @property
    def name(self) -> str:
        """Ends the names of its pictures."""
        return f"campaign-{self.subject.id}"

    @property
    def at_collision(self) -> bool:
        """Whether the failures were put side by side at their collision."""
        return self.analysis.settings.align == "collision"

    @property
    def modes_note(self) -> str:
        """That not all modes are drawn; empty if they are."""
        count = len(self.result.modes)
        return "" if count <= MOST_MODES else f"The {MOST_MODES} largest of {count} modes."

    def members(self, mode: int) -> list[tuple[int, int]]:
        """Campaign and episode of each failure of a mode."""
        count, own = len(self.result.episodes), self.subject.id
        campaigns = self.result.campaigns or (own,) * count
        rows = zip(campaigns, self.result.episodes, self.result.labels, strict=True)
        return [(campaign, episode) for campaign, episode, label in rows if label == mode]


def analysed(material: Material) -> Iterator[Analysed]:
    """Those that have an analysis with a mode."""
    for subject in material.subjects:
        analysis = subject.analysis
        if analysis is not None and analysis.result is not None and analysis.result.modes:
            medoids = tuple(
                material.store.episodes.get(mode.medoid_campaign or subject.id, mode.medoid)
                for mode in analysis.result.modes
            )
            duration = known_step_s(subject.campaign.spec)
            yield Analysed(subject, analysis, analysis.result, medoids, duration)


def known_step_s(spec: CampaignSpec) -> float | None:
    """The duration of a step; None of a scenario that is not here any more. [s]"""
    try:
        return step_s(spec)
    except InputError:
        return None


class Band(NamedTuple):
    """The noise of a mode's members over time, where the eigenfailure lies.

    Attributes:
        shown: how many members it rests on, of so many.
        reached: how many of them reached each step, shape (steps,).
        mean: of z, shape (steps, 2); NaN where no member is. [sigma]
        deviation: standard deviation (n − 1), likewise; NaN where fewer than two are.
    """

    shown: int
    of: int
    reached: NDArray[np.int64]
    mean: NDArray[np.float64]
    deviation: NDArray[np.float64]


def band(store: Store, found: Analysed, mode: int) -> Band:
    """The noise of a mode's members, each at its first step or, if so aligned, at its collision."""
    members = found.members(mode)
    chosen = evenly(members, MOST_MEMBERS)
    noise = [
        result.noise.z
        for campaign in dict.fromkeys(campaign for campaign, _ in chosen)
        for result in store.episodes.finished(campaign, [e for c, e in chosen if c == campaign])
    ]
    rows = side_by_side(noise, len(found.result.modes[mode].eigenfailure), found.at_collision)
    return Band(len(noise), len(members), *spread(rows))


def side_by_side(noise: list[Floats], steps: int, at_collision: bool) -> NDArray[np.float64]:
    """Noise trajectories in rows of one length, NaN where there is none.

    Args:
        noise: z of each, shape (its steps, 2).
        steps: of a row.
        at_collision: whether their last steps, not the first ones, stand side by side: at the
            median length, as an eigenfailure does.
    """
    rows = np.full((len(noise), steps, 2), np.nan)
    last = int(np.quantile([len(z) for z in noise], 0.5, method="higher")) if noise else 0
    for row, z in zip(rows, noise, strict=True):
        first = last - len(z) if at_collision else 0
        kept = z[max(-first, 0) :][:steps]
        row[max(first, 0) : max(first, 0) + len(kept)] = kept
    return rows


def spread(
    rows: NDArray[np.float64],
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """How many rows reach each step, their mean and their standard deviation there."""
    reached = np.isfinite(rows[:, :, 0]).sum(axis=0)
    n = np.where(reached > 0, reached, np.nan)[:, None]
    mean = np.nansum(rows, axis=0) / n
    squares = np.nansum((rows - mean) ** 2, axis=0)
    return reached, mean, np.sqrt(squares / np.where(n > 1, n - 1.0, np.nan))
