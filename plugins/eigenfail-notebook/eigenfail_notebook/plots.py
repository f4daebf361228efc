"""Values as diagrams of matplotlib, for notebooks and papers.

A diagram shows only the figures of its value: intervals are drawn if the value has them, and
unknown values are left out.
"""

from collections.abc import Sequence
from functools import singledispatch
from typing import TYPE_CHECKING

import numpy as np

from eigenfail.errors import InvalidValue
from eigenfail.presentation.analyses import pick_channels
from eigenfail.presentation.figures import count_noun
from eigenfail.values.analysis import Analysis, AnalysisResult, FailureMode
from eigenfail.values.arrays import Floats
from eigenfail.values.campaign import Campaign
from eigenfail.values.comparison import Comparison
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.estimates import Rate
from eigenfail.values.records import EpisodeDetail
from eigenfail.values.safety import Safety
from eigenfail.values.summary import CampaignCost, Course
from eigenfail_notebook.frames import number_channels, result_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FAILURES, OTHERS, ERRORED, OPEN = "#c0392b", "#4c78a8", "#8c8c8c", "#d9d9d9"
"""Colours of failures, of other completed episodes, of errored ones, and of those to come."""


def plot(value: object, ax: "Axes | None" = None) -> "Axes":
    """Draw a value with matplotlib.

    Args:
        value: a campaign, its course, costs or safety, a comparison, an analysis, a failure mode,
            an episode or its noise.
        ax: axes into which it is drawn; None: a new figure.

    Returns:
        The axes, to go on drawing; their `figure` can be saved.

    Raises:
        InvalidValue: the value has nothing that could be drawn.
    """
    if ax is not None:
        _draw(value, ax)
        return ax
    # pyplot chooses a backend as it is imported, which a notebook may still want to set.
    from matplotlib import pyplot as plt

    figure, made = plt.subplots(layout="constrained")
    try:
        _draw(value, made)
    except InvalidValue:
        plt.close(figure)  # or a notebook would show it, empty
        raise
    return made


@singledispatch
def _draw(value: object, axes: "Axes") -> None:  # noqa: ARG001 - of the kinds that are registered
    problem = f"there is nothing to draw in a {type(value).__name__}."
    raise InvalidValue("value", problem, "Plot a campaign, its course, an analysis or an episode.")


@_draw.register(Campaign)
def _(value: Campaign, axes: "Axes") -> None:
    counts = value.counts
    sizes = {
        "failures": counts.failures,
        "other completed": counts.completed - counts.failures,
        "errored": counts.errored,
        "cancelled or open": counts.cancelled + counts.open,
    }
    bars = axes.barh([*sizes], [*sizes.values()], color=(FAILURES, OTHERS, ERRORED, OPEN))
    axes.bar_label(bars, padding=3)
    axes.invert_yaxis()
    axes.set(xlabel="episodes", title=f"Campaign {value.id}: {value.spec.name}")


@_draw.register(Course)
def _(value: Course, axes: "Axes") -> None:
    middles = [(block.first + block.last) / 2 for block in value.blocks]
    _draw_rates(axes, middles, [block.failure_rate for block in value.blocks])
    axes.set(xlabel="episode", ylabel="failures ÷ completed episodes")
    axes.set_title(f"Campaign {value.campaign}: {value.heading}")


@_draw.register(CampaignCost)
def _(value: CampaignCost, axes: "Axes") -> None:
    spent = [point.usd for point in value.curve]
    axes.step(spent, [point.failures for point in value.curve], where="post", label="failures")
    if any(point.modes is not None for point in value.curve):
        modes = [np.nan if point.modes is None else point.modes for point in value.curve]
        axes.step(spent, modes, where="post", label="modes")
        axes.legend()
        axes.set_ylabel("failures and modes found")
    else:
        axes.set_ylabel("failures found")
    axes.set(xlabel="cost [USD]", title=f"Campaign {value.campaign}: {value.name}")


@_draw.register(Safety)
def _(value: Safety, axes: "Axes") -> None:
    points = value.scatter.points
    likelihoods = [point.log_probability_per_step for point in points]
    axes.scatter(likelihoods, [point.severity for point in points], s=12, color=FAILURES)
    axes.set(xlabel="log p per step [nats]", ylabel="severity [m²/s²]")
    found = count_noun(value.scatter.of, "failure")
    axes.set_title(f"Campaign {value.campaign}: {value.name}, {found}")


@_draw.register(Comparison)
def _(value: Comparison, axes: "Axes") -> None:
    sides = [(name, side) for name, side in (("A", value.a), ("B", value.b)) if side.failure_rate]
    rates = [side.failure_rate for _, side in sides if side.failure_rate]
    _draw_rates(axes, range(len(rates)), rates)
    for place, (_, side) in enumerate(sides):
        seeds = [rate for rate in side.rates if rate is not None]
        if len(seeds) > 1:
            axes.plot([place] * len(seeds), seeds, ".", color=ERRORED, label="campaigns")
    labels = [f"{name}: {', '.join(map(str, side.campaigns))}" for name, side in sides]
    axes.set_xticks(range(len(labels)), labels)
    axes.set(xlim=(-0.5, max(len(labels), 1) - 0.5), ylabel="failures ÷ completed episodes")
    axes.set(xlabel="campaigns", title="Comparison")


@_draw.register(Analysis)
def _(value: Analysis, axes: "Axes") -> None:
    _draw(result_of(value), axes)
    axes.set_title(f"Analysis {value.id}: {axes.get_title()}")


@_draw.register(AnalysisResult)
def _(value: AnalysisResult, axes: "Axes") -> None:
    labels = np.array(value.labels, dtype=int)
    across = value.scores[:, 1] if value.scores.shape[1] > 1 else np.zeros(len(labels))
    for mode in sorted({*value.labels}):
        members = labels == mode
        named = f"{mode + 1}: {count_noun(int(members.sum()), 'failure')}"
        axes.scatter(value.scores[members, 0], across[members], s=12, label=named)
    axes.set(xlabel="component 1", ylabel="component 2" if value.scores.shape[1] > 1 else "")
    axes.set_title("failure modes" if value.distinct else "groups of failures")
    if value.labels:
        axes.legend(title="mode" if value.distinct else "group")


@_draw.register(FailureMode)
def _(value: FailureMode, axes: "Axes") -> None:
    channels = number_channels(value.eigenfailure.shape[1])
    steps = _count_steps(value)
    band = None if value.band is None else value.band[:, :steps]
    _draw_noise(axes, value.eigenfailure[:steps], channels, band)
    owner, medoid = value.medoid_campaign, value.medoid
    named = f"episode {medoid}" if owner is None else f"episode {owner}/{medoid}"
    mode = f"mode {value.number}, " if value.number else ""
    failures = count_noun(value.failures, "failure")
    axes.set_title(f"Eigenfailure of {mode}{failures}, medoid {named}")


@_draw.register(NoiseTrajectory)
def _(value: NoiseTrajectory, axes: "Axes") -> None:
    _draw_noise(axes, value.z, number_channels(value.z.shape[1]))
    axes.set_title("Noise")


@_draw.register(EpisodeDetail)
def _(value: EpisodeDetail, axes: "Axes") -> None:
    _draw_noise(axes, value.noise.z, value.channels)
    named = value.index if value.campaign is None else f"{value.campaign}/{value.index}"
    axes.set_title(f"Episode {named}: {value.outcome.word}")


def _count_steps(mode: FailureMode) -> int:
    """Return the number of steps until the last failure of a mode ended.

    An eigenfailure is as long as the horizon: behind the last step of any failure it is zero, and
    so is its band.
    """
    parts = [mode.eigenfailure] if mode.band is None else [mode.eigenfailure, *mode.band]
    reached = np.flatnonzero(np.any([part != 0.0 for part in parts], axis=(0, 2)))
    return int(reached[-1]) + 1 if len(reached) else len(mode.eigenfailure)


def _draw_noise(
    axes: "Axes", z: Floats, channels: Sequence[str], band: Floats | None = None
) -> None:
    """Draw the noise by step, of the channels with the strongest noise, with its band if any."""
    drawn = pick_channels(np.square(z))
    for place in drawn:
        name = channels[place]
        (line,) = axes.plot(np.arange(len(z)), z[:, place], label=name, drawstyle="steps-mid")
        if band is not None:
            low, high = band[:, :, place]
            steps, colour = np.arange(len(low)), line.get_color()
            axes.fill_between(steps, low, high, color=colour, alpha=0.2, linewidth=0)
    axes.axhline(0.0, color=OPEN, linewidth=0.8, zorder=0)
    axes.set(xlabel="step", ylabel="z [sigma]")
    left_out = f"{len(drawn)} of {len(channels)} channels" if len(drawn) < len(channels) else None
    axes.legend(title=left_out)


def _draw_rates(axes: "Axes", places: Sequence[float], rates: Sequence[Rate]) -> None:
    """Draw rates from 0 on with their intervals; rates of searches do not have intervals."""
    shares = [rate.share for rate in rates]
    (points,) = axes.plot(places, shares, "o", color=FAILURES, clip_on=False)
    # Limits that were set would cut off what is drawn into the same axes later.
    points.sticky_edges.y.append(0.0)
    axes.update_datalim([(place, 0.0) for place in places])
    bounds = [(at, rate.interval) for at, rate in zip(places, rates, strict=True) if rate.interval]
    if bounds:
        at, intervals = zip(*bounds, strict=True)
        low, high = [each.low for each in intervals], [each.high for each in intervals]
        axes.vlines(at, low, high, color=FAILURES, linewidth=1.2)
    axes.autoscale_view()
