"""What the failures have in common: their modes, and whether these are more than chance."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from eigenfail.values import AXES, Estimate, FailureMode
from eigenfail.values.report import Cell, ReportPicture, ReportSection
from eigenfail_services.reports.analysed import Analysed, analysed
from eigenfail_services.reports.material import Material, Subject
from eigenfail_services.reports.parts import Drawing, Part, table
from eigenfail_services.reports.pictures import INK, legend, mark
from eigenfail_services.reports.samples import evenly, sample_note

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MODES, WORDS, SCORES = "modes", "mode-words", "scores"
MOST_SCORES = 2_000
LEGEND_COLUMNS = 4
A_SUMMARY = "Read them as a summary of the failures, not as separate causes."
CENTRES = "Numbers in boxes are the centres of the modes."
PLATE = {"boxstyle": "round,pad=0.2", "facecolor": "white", "edgecolor": INK}
MODE_COLUMNS = (
    ("campaign", "Campaign"),
    ("analysis", "Analysis"),
    ("mode", "Mode"),
    ("failures", "Failures"),
    ("share", "Share", "share"),
    ("medoid", "Medoid episode"),
    ("strength", "Root mean square", "sigma"),
    ("peak_longitudinal", "Longitudinal peak", "sigma"),
    ("peak_longitudinal_step", "at step"),
    ("peak_lateral", "Lateral peak", "sigma"),
    ("peak_lateral_step", "at step"),
    ("probability", "Probability under p(x)"),
    ("probability_low", "from"),
    ("probability_high", "to"),
)
WORD_COLUMNS = (("campaign", "Campaign"), ("mode", "Mode"), ("words", "What it is"))
SCORE_COLUMNS = (
    ("campaign", "Campaign"),
    ("episode", "Episode"),
    ("mode", "Mode"),
    ("score_1", "First score", "sigma"),
    ("score_2", "Second score", "sigma"),
)
HOW_TO_READ = (
    "The noise of all failures is brought to a few principal components; clusters there are the "
    "failure modes. The centre of a cluster, taken back to noise, is its eigenfailure; the medoid "
    "is the real failure nearest to it. Peaks are those of the eigenfailure: positive is ahead "
    "along the road, and towards +y across it."
)


def part(material: Material) -> Part:
    """The modes of every campaign that was analysed."""
    found = [*analysed(material)]
    tables = (
        table(MODES, "Failure modes", MODE_COLUMNS, [row for each in found for row in modes(each)]),
        table(
            SCORES,
            "Failures in the space of the components",
            SCORE_COLUMNS,
            [row for each in found for row in scores(each)],
            " ".join(filter(None, map(left_out, found))),
        ),
        table(
            WORDS, "The modes in words", WORD_COLUMNS, [row for of in found for row in words(of)]
        ),
    )
    section = ReportSection(
        name="modes",
        title="Failure modes",
        words=(
            *((HOW_TO_READ,) if found else ()),
            *(sentence for each in found for sentence in told(each)),
            *missing(material, found),
        ),
        tables=tables if found else (),
        pictures=tuple(map(picture, found)),
    )
    drawings = {picture(each).name: drawing(each) for each in found}
    return Part(section, drawings=drawings, folded=frozenset({WORDS}))


def missing(material: Material, found: list[Analysed]) -> Iterator[str]:
    """Of which campaigns no mode can be told, and why."""
    known = {each.subject.id for each in found}
    for subject in material.subjects:
        if subject.id not in known:
            yield f"Campaign {subject.id}: {why(subject)}"


def why(subject: Subject) -> str:
    """Why there is no mode."""
    if not subject.summary.counts.failures:
        return "no failure, so there is no mode."
    return f"not analysed; run `eigenfail analyze {subject.id}` and make the report again."


def told(found: Analysed) -> Iterator[str]:
    """Whether the modes of a campaign are real, what each is, and what to know of them."""
    result, who = found.result, f"Campaign {found.subject.id}"
    caution = "" if result.distinct else f" {A_SUMMARY}"
    yield f"{who} (analysis {found.analysis.id}): {result.verdict}{caution}"
    if result.diversity and result.diversity.warning:
        yield f"{who}: {result.diversity.warning.capitalize()}"
    yield from (f"{who}: {note}" for note in result.notes)


def modes(found: Analysed) -> Iterator[tuple[Cell, ...]]:
    """A row for each mode, counted from 1."""
    for number, mode in enumerate(found.result.modes, start=1):
        share = mode.failures / len(found.result.episodes)
        who = (found.subject.id, found.analysis.id, number)
        likely = probability(mode.probability)
        yield (*who, mode.failures, share, mode.medoid, strength(mode), *peaks(mode), *likely)


def words(found: Analysed) -> Iterator[tuple[Cell, ...]]:
    """What each mode is, as the analysis says."""
    for number, told_of_it in enumerate(found.result.words, start=1):
        yield (found.subject.id, number, told_of_it)


def probability(found: Estimate | None) -> tuple[Cell, ...]:
    """Of a failure of a mode, with its interval."""
    if found is None or found.interval is None:
        return (None, None, None)
    return (found.probability, found.interval.low, found.interval.high)


def strength(mode: FailureMode) -> float:
    """Root mean square of the eigenfailure; noise of p(x) has 1. [sigma]"""
    return float(np.sqrt(np.mean(np.square(mode.eigenfailure.astype(np.float64)))))


def peaks(mode: FailureMode) -> Iterator[Cell]:
    """The largest disturbance along each axis, and its step."""
    for axis in range(len(AXES)):
        step = int(np.argmax(np.abs(mode.eigenfailure[:, axis])))
        yield float(mode.eigenfailure[step, axis])
        yield step


def scores(found: Analysed) -> Iterator[tuple[Cell, ...]]:
    """A row for each failure, or for a sample of them."""
    result = found.result
    for row in evenly(range(len(result.episodes)), MOST_SCORES):
        first, second = (float(x) for x in np.pad(result.scores[row].astype(float), (0, 2))[:2])
        yield (found.subject.id, result.episodes[row], result.labels[row] + 1, first, second)


def left_out(found: Analysed) -> str:
    """Whether all failures are there."""
    count = len(found.result.episodes)
    note = sample_note(min(count, MOST_SCORES), count, "failures")
    return f"Campaign {found.subject.id}: {note}" if note else ""


def picture(found: Analysed) -> ReportPicture:
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
        note=left_out(found),
    )


def centre(mode: FailureMode) -> tuple[float, float]:
    """Of a mode, by its first two scores."""
    first, second = np.pad(mode.centre.astype(float), (0, 2))[:2]
    return (float(first), float(second))


def drawing(found: Analysed) -> Drawing:
    """A mark for each failure, by its mode."""
    rows = [*scores(found)]
    centres = [centre(mode) for mode in found.result.modes]

    def draw(figure: "Figure") -> None:
        axes = figure.subplots()
        for mode, middle in enumerate(centres):
            here = [(row[3], row[4]) for row in rows if row[2] == mode + 1]
            axes.plot(
                *zip(*here, strict=True) if here else ((), ()),
                linestyle="none",
                marker=mark(mode).marker,
                markerfacecolor="none",
                markeredgecolor=mark(mode).colour,
                markeredgewidth=0.9,
                label=f"mode {mode + 1}",
            )
            axes.annotate(str(mode + 1), middle, ha="center", va="center", bbox=PLATE)
        axes.set_xlabel("first score [sigma]")
        axes.set_ylabel("second score [sigma]")
        legend(axes, LEGEND_COLUMNS)

    return Drawing(draw, 3.8)
