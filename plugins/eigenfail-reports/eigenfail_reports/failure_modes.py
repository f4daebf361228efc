"""Failure modes and their eigenfailures."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from eigenfail.presentation import svg
from eigenfail.presentation.figures import format_number
from eigenfail.values.analysis import FailureMode
from eigenfail.values.arrays import Floats
from eigenfail.values.disturbance import AXES
from eigenfail_reports import page
from eigenfail_reports.contents import Cell, ReportPicture
from eigenfail_reports.material import (
    MOST_MODES,
    Analysed,
    Band,
    Material,
    Subject,
    arrange_by_channel,
    list_analysed,
    list_channels,
    make_band,
    pick_evenly,
    sample_note,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


MODES, WORDS, SCORES = "modes", "mode-words", "scores"


MOST_SCORES = 2_000


LEGEND_COLUMNS = 4


A_SUMMARY = "Read them as a summary of the failures, not as separate causes."


CENTRES = "Numbers in boxes are the centres of the modes."


PLATE = {"boxstyle": "round,pad=0.2", "facecolor": "white", "edgecolor": svg.INK}


WORD_COLUMNS = (("campaign", "Campaign"), ("mode", "Mode"), ("words", "What it is"))


SCORE_COLUMNS = (
    ("campaign", "Campaign"),
    ("episode", "Episode"),
    ("mode", "Mode"),
    ("score_1", "First score", "sigma"),
    ("score_2", "Second score", "sigma"),
)


HOW_TO_READ = (
    "Failures are grouped by the behaviour of the ego before the collision, or by their noise. "
    "Clusters of their principal components are the failure modes. The eigenfailure is the centre "
    "of a cluster's noise, and the medoid is the failure nearest to the centre. Peaks are those of "
    "the eigenfailure, within the steps that at least half of the failures reach"
)


def explain_modes(channels: Sequence[str]) -> str:
    """Return how to read the modes, with the sense of the noise if it is an error of position."""
    if not {*AXES} & {*channels}:
        return f"{HOW_TO_READ}."
    return f"{HOW_TO_READ}: positive is ahead along the road, and towards +y across it."


def list_mode_columns(channels: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """Return the columns of the table of modes."""
    return (
        ("campaign", "Campaign"),
        ("analysis", "Analysis"),
        ("mode", "Mode"),
        ("failures", "Failures"),
        ("share", "Share", "share"),
        ("medoid", "Medoid episode"),
        ("strength", "Root mean square", "sigma"),
        *(
            column
            for channel in channels
            for column in (
                (f"peak_{channel}", f"{channel.capitalize()} peak", "sigma"),
                (f"peak_{channel}_step", "at step"),
            )
        ),
        ("probability", "Probability under p(x)"),
        ("probability_low", "from"),
        ("probability_high", "to"),
        ("probability_at_least", "Probability under p(x) at least"),
    )


def make_modes(material: Material) -> page.ReportPart:
    """The modes of every campaign that was analysed."""
    found = [*list_analysed(material)]
    channels = list_channels(found)
    tables = (
        page.make_table(
            MODES,
            "Failure modes",
            list_mode_columns(channels),
            [row for each in found for row in list_mode_rows(each, channels)],
        ),
        page.make_table(
            SCORES,
            "Failures in the space of the components",
            SCORE_COLUMNS,
            [row for each in found for row in list_score_rows(each)],
            " ".join(filter(None, map(describe_left_out, found))),
        ),
        page.make_table(
            WORDS,
            "The modes in words",
            WORD_COLUMNS,
            [row for of in found for row in list_description_rows(of)],
        ),
    )
    return page.ReportPart(
        name="modes",
        title="Failure modes",
        words=(
            *((explain_modes(channels),) if found else ()),
            *(sentence for each in found for sentence in describe_modes(each)),
            *list_missing(material, found),
        ),
        tables=tables if found else (),
        pictures=tuple((describe_modes_picture(each), draw_modes(each)) for each in found),
        folded=frozenset({WORDS}),
    )


def list_missing(material: Material, found: list[Analysed]) -> Iterator[str]:
    """Return the campaigns without failure modes, with the reasons."""
    known = {each.subject.id for each in found}
    for subject in material.subjects:
        if subject.id not in known:
            yield f"Campaign {subject.id}: {explain_no_modes(subject)}"


def explain_no_modes(subject: Subject) -> str:
    """Return why a campaign lacks modes."""
    if not subject.summary.counts.failures:
        return "no failure, so there is no mode."
    return f"not analysed; run `eigenfail analyze {subject.id}` and make the report again."


def describe_modes(found: Analysed) -> Iterator[str]:
    """Yield the verdict on a campaign's modes, any collapse of their diversity, and notes."""
    result, who = found.result, f"Campaign {found.subject.id}"
    caution = result.caution if result.distinct else A_SUMMARY
    yield f"{who} (analysis {found.analysis.id}): {result.verdict} {caution}".rstrip()
    if result.diversity and result.diversity.collapse:
        yield f"{who}: {result.diversity.collapse}"
    yield from (f"{who}: {note}" for note in result.notes)


def list_mode_rows(found: Analysed, channels: Sequence[str]) -> Iterator[tuple[Cell, ...]]:
    """Yield a row for each mode, counted from 1."""
    for number, mode in enumerate(found.result.modes, start=1):
        share = mode.failures / len(found.result.episodes)
        who = (found.subject.id, found.analysis.id, number)
        likely = page.list_probability(mode.probability)
        yield (
            *who,
            mode.failures,
            share,
            mode.medoid,
            measure_strength(mode),
            *arrange_by_channel(list_peak_cells(mode), found.result.channels, channels),
            *likely,
        )


def list_description_rows(found: Analysed) -> Iterator[tuple[Cell, ...]]:
    """Yield the analysis's description of each mode."""
    for number, told_of_it in enumerate(found.result.words, start=1):
        yield (found.subject.id, number, told_of_it)


def measure_strength(mode: FailureMode) -> float:
    """Return the root mean square of the eigenfailure; noise of p(x) has 1. [sigma]"""
    return float(np.sqrt(np.mean(np.square(mode.typical.astype(np.float64)))))


def list_peak_cells(mode: FailureMode) -> list[tuple[float, int]]:
    """Return the largest disturbance of each channel, and its step."""
    z = mode.typical
    steps = np.argmax(np.abs(z), axis=0).tolist()
    return [(float(z[step, way]), step) for way, step in enumerate(steps)]


def list_score_rows(found: Analysed) -> Iterator[tuple[Cell, ...]]:
    """Yield a row for each failure, or for a sample of the failures."""
    result = found.result
    for row in pick_evenly(range(len(result.episodes)), MOST_SCORES):
        first, second = (float(x) for x in np.pad(result.scores[row].astype(float), (0, 2))[:2])
        yield (found.subject.id, result.episodes[row], result.labels[row] + 1, first, second)


def describe_left_out(found: Analysed) -> str:
    """Return whether all failures are shown."""
    count = len(found.result.episodes)
    note = sample_note(min(count, MOST_SCORES), count, "failures")
    return f"Campaign {found.subject.id}: {note}" if note else ""


def describe_modes_picture(found: Analysed) -> ReportPicture:
    """The failures of a campaign in the space of the components, in words."""
    sizes = ", ".join(
        f"mode {number} with {mode.failures}" for number, mode in enumerate(found.result.modes, 1)
    )
    return ReportPicture(
        name=f"scores-{found.name}",
        title=f"Failures by their first two scores, campaign {found.subject.label}",
        alternative=f"{len(found.result.episodes)} failures: {sizes}. {CENTRES}",
        table=SCORES,
        campaigns=(found.subject.id,),
        note=describe_left_out(found),
    )


def find_centre(mode: FailureMode) -> tuple[float, float]:
    """Return the centre of a mode in its first two scores."""
    first, second = np.pad(mode.centre.astype(float), (0, 2))[:2]
    return (float(first), float(second))


def draw_modes(found: Analysed) -> svg.Drawing:
    """A mark for each failure, by its mode."""
    rows = [*list_score_rows(found)]
    centres = [find_centre(mode) for mode in found.result.modes]

    def draw(figure: "Figure") -> None:
        axes = figure.subplots()
        for mode, middle in enumerate(centres):
            here = [(row[3], row[4]) for row in rows if row[2] == mode + 1]
            axes.plot(
                *zip(*here, strict=True) if here else ((), ()),
                linestyle="none",
                marker=svg.pick_mark(mode).marker,
                markerfacecolor="none",
                markeredgecolor=svg.pick_mark(mode).colour,
                markeredgewidth=0.9,
                label=f"mode {mode + 1}",
            )
            axes.annotate(str(mode + 1), middle, ha="center", va="center", bbox=PLATE)
        axes.set_xlabel("first score [sigma]")
        axes.set_ylabel("second score [sigma]")
        page.draw_legend(axes, LEGEND_COLUMNS)

    return svg.Drawing(draw, 3.8)


EIGENFAILURES_TABLE = "eigenfailures"


def list_eigenfailure_columns(channels: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """Return the columns of the table of eigenfailures."""
    return (
        ("campaign", "Campaign"),
        ("mode", "Mode"),
        ("step", "Step"),
        ("time_s", "Time", "s"),
        ("members", "Members at this step"),
        *(
            (f"{kind}_{channel}", f"{title}, {channel}", "sigma")
            for channel in channels
            for kind, title in (
                ("eigenfailure", "Eigenfailure"),
                ("mean", "Mean of the members"),
                ("deviation", "Standard deviation"),
            )
        ),
    )


EIGENFAILURES_WORDS = (
    "The line is the eigenfailure, ready to be injected; the hatched band is the mean of the "
    "mode's members ± their standard deviation, at the steps that they reached. Where the band is "
    "narrower than ± 1 the failures agree on more than the disturbance model does."
)


Bands = tuple[Band, ...]


def make_eigenfailures(material: Material) -> page.ReportPart | None:
    """The eigenfailures of every campaign that was analysed."""
    found = [*list_analysed(material)]
    if not found:
        return None
    bands = [make_bands(material, each) for each in found]
    each_with = [*zip(found, bands, strict=True)]
    channels = list_channels(found)
    columns = list_eigenfailure_columns(channels)
    rows = [row for each, of in each_with for row in list_eigenfailures_steps(each, of, channels)]
    return page.ReportPart(
        name="eigenfailures",
        title="Eigenfailures",
        words=(EIGENFAILURES_WORDS,),
        tables=(page.make_table(EIGENFAILURES_TABLE, "Eigenfailures over time", columns, rows),),
        pictures=tuple(
            (describe_eigenfailures_picture(each, of), draw_eigenfailures(each, of))
            for each, of in each_with
        ),
    )


def make_bands(material: Material, found: Analysed) -> Bands:
    """Return the band of each mode."""
    return tuple(make_band(material.store, found, mode) for mode in range(len(found.result.modes)))


def list_eigenfailures_steps(
    found: Analysed, bands: Bands, channels: Sequence[str]
) -> Iterator[tuple[Cell, ...]]:
    """A row for each step of each mode."""
    for number, (mode, of) in enumerate(zip(found.result.modes, bands, strict=True), start=1):
        for step, z in enumerate(mode.eigenfailure.astype(float)):
            at_s = step * found.step_s if found.step_s else None
            figures = np.stack([z, of.mean[step], of.deviation[step]], axis=1)
            cells = [
                tuple(float(value) if np.isfinite(value) else None for value in row)
                for row in figures
            ]
            placed = arrange_by_channel(cells, found.result.channels, channels)
            yield (found.subject.id, number, step, at_s, int(of.reached[step]), *placed)


def describe_eigenfailures_picture(found: Analysed, bands: Bands) -> ReportPicture:
    """The eigenfailures of a campaign, in words."""
    sentences = (
        f"mode {number}: {describe_peak(found, mode.typical)}"
        for number, mode in enumerate(found.result.modes[:MOST_MODES], start=1)
    )
    of = sum(each.of for each in bands)
    sample = sample_note(sum(each.shown for each in bands), of, "members")
    notes = (found.modes_note, found.channels_note, sample)
    return ReportPicture(
        name=f"eigenfailures-{found.name}",
        title=f"Eigenfailures, campaign {found.subject.label}",
        alternative=f"{'; '.join(sentences)}.".capitalize(),
        table=EIGENFAILURES_TABLE,
        campaigns=(found.subject.id,),
        note=" ".join(filter(None, notes)),
    )


def describe_peak(found: Analysed, z: Floats) -> str:
    """Return the largest disturbance of each channel that is drawn, as text."""
    largest = (
        (channel, int(np.argmax(np.abs(z[:, way]))), way) for way, channel in found.drawn_channels
    )
    return ", ".join(
        f"{channel} {format_number(float(z[step, way]))} sigma at {describe_moment(found, step)}"
        for channel, step, way in largest
    )


def describe_moment(found: Analysed, step: int) -> str:
    """Return the time of a step as text."""
    return f"{format_number(step * found.step_s)} s" if found.step_s else f"step {step}"


def draw_eigenfailures(found: Analysed, bands: Bands) -> svg.Drawing:
    """A row for each mode, a panel for each channel."""
    modes, channels = found.result.modes[:MOST_MODES], found.drawn_channels

    def draw(figure: "Figure") -> None:
        groups = page.draw_panels(figure, len(modes), len(channels))
        for number, panels in enumerate(groups):
            for axes, (way, channel) in zip(panels, channels, strict=True):
                draw_mode(axes, found, bands[number], number, way)
                axes.set_title(f"mode {number + 1}, {channel}")
        page.title_panels(groups, "time [s]" if found.step_s else "step", "noise [sigma]")

    return svg.Drawing(draw, 0.6 + 1.7 * len(modes) * page.count_panel_rows(len(channels)))


def draw_mode(axes: "Axes", found: Analysed, of: Band, mode: int, way: int) -> None:
    """Draw one channel of a mode."""
    z = found.result.modes[mode].eigenfailure[:, way]
    at = np.arange(len(z)) * (found.step_s or 1.0)
    low, high = of.mean[:, way] - of.deviation[:, way], of.mean[:, way] + of.deviation[:, way]
    axes.fill_between(
        at, low, high, facecolor="none", edgecolor=svg.MUTED, hatch="////", linewidth=0.0
    )
    for edge in (low, high):
        axes.plot(at, edge, color=svg.MUTED, linewidth=0.8, linestyle=(0, (1.2, 1.6)))
    axes.axhline(0.0, color=svg.MUTED, linewidth=0.8)
    axes.plot(at, z, color=svg.pick_mark(mode).colour, linewidth=1.8)
