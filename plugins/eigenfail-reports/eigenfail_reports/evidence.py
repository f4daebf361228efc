"""Proof by replay, variance explained, and training: how far the modes can be trusted."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eigenfail.presentation import svg
from eigenfail.presentation.figures import format_share
from eigenfail.values.proof import Proof, ReplayedNoise, Reproduction
from eigenfail_reports import page
from eigenfail_reports.contents import Cell, ReportPicture
from eigenfail_reports.material import (
    Analysed,
    Material,
    arrange_by_channel,
    list_analysed,
    list_channels,
)
from eigenfail_services.campaigns.proofs import summarise_proof

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


SCENARIOS, REPLAYS = "proof", "replays"


SCENARIO_COLUMNS = (
    ("campaign", "Campaign"),
    ("scenario", "Scenario"),
    ("replay", "Replay campaign"),
    ("what", "What was injected"),
    ("reproduced", "Failed again"),
    ("tried", "Tried"),
)


REPLAY_COLUMNS = (
    ("campaign", "Campaign"),
    ("replay", "Replay campaign"),
    ("episode", "Episode"),
    ("what", "What was injected"),
    ("mode", "Mode"),
    ("reproduced", "Failed again"),
)


LIKELIHOOD_COLUMNS = (
    ("log_p", "log p", "nat"),
    ("expected_log_p", "Mean log p of p(x)", "nat"),
)


PROOF_WORDS = (
    "An eigenfailure is injected again: if it ends in a {failure} in the scenario in which its "
    "failures were found, it is a failure itself, and says more if it is one in others too. "
    "Medoids are failures that happened, injected in the same way. Replays are deterministic and "
    "repeat chosen noise: they are counted, and their share estimates no probability."
)


HEADER = ("Campaign", "Scenario", "Eigenfailures that failed again", "Medoids that failed again")


class Proven(NamedTuple):
    """A campaign whose analysis was replayed."""

    found: Analysed
    proof: Proof


def make_proof(material: Material) -> page.ReportPart | None:
    """The replays of every analysis that was replayed."""
    proofs = (
        Proven(each, summarise_proof(material.store, each.analysis))
        for each in list_analysed(material)
    )
    proven = [each for each in proofs if each.proof.scenarios]
    if not proven:
        return None
    unit = material.robustness_unit
    scenario_columns = (*SCENARIO_COLUMNS, ("smallest_robustness_m", "Smallest robustness", unit))
    replay_columns = (
        *REPLAY_COLUMNS,
        ("robustness_m", "Robustness", unit),
        *LIKELIHOOD_COLUMNS,
    )
    failure = "collision" if material.robustness_unit == "m" else "failure"
    rows = tuple(row for each in proven for row in list_scenario_texts(each))
    return page.ReportPart(
        name="proof",
        title="Replays of modes",
        words=(PROOF_WORDS.format(failure=failure), *map(describe_proof, proven)),
        tables=(
            page.make_table(
                SCENARIOS, "Replays by scenario", scenario_columns, [*list_scenario_rows(proven)]
            ),
            page.make_table(REPLAYS, "Each replay", replay_columns, [*replay_rows(proven)]),
        ),
        grids={SCENARIOS: (page.Grid(HEADER, rows),)},
        folded=frozenset({REPLAYS}),
    )


def describe_proof(proven: Proven) -> str:
    """Return how many eigenfailures of a campaign fail again, as a sentence."""
    here, everywhere = proven.proof.reproduced, proven.proof.eigenfailures
    unfinished = "" if proven.proof.done else " Replays are still running."
    return (
        f"Campaign {proven.found.subject.id}: of its eigenfailures {format_reproduced(here)} "
        f"failed again in the same scenario, {format_reproduced(everywhere)} over all scenarios."
        f"{unfinished}{describe_nearest(proven.proof)}"
    )


def describe_nearest(proof: Proof) -> str:
    """Return the failing noise nearest to each mode's centre; empty if not known."""
    places = [f"{each.number} at {each.nearest.words}" for each in proof.modes if each.nearest]
    return f" Nearest failing points, by mode: {'; '.join(places)}." if places else ""


def format_reproduced(found: Reproduction) -> str:
    """Return how many of the replays failed again, as "3 of 4"."""
    return f"{found.rate.k} of {found.rate.n}" if found.rate else "none tried"


def list_scenario_texts(proven: Proven) -> Iterator[tuple[tuple[str, ...], ...]]:
    """Yield a row of texts for each scenario."""
    for each in proven.proof.scenarios:
        who = ((str(proven.found.subject.id),), (each.words,))
        counts = map(format_reproduced, (each.eigenfailures, each.medoids))
        yield (*who, *((count,) for count in counts))


def list_scenario_rows(proven: list[Proven]) -> Iterator[tuple[Cell, ...]]:
    """Yield two rows for each scenario."""
    for found, proof_of in proven:
        for each in proof_of.scenarios:
            who = (found.subject.id, each.words, each.campaign)
            yield (*who, "eigenfailures", *count_reproduced(each.eigenfailures))
            yield (*who, "medoids", *count_reproduced(each.medoids))


def count_reproduced(found: Reproduction) -> tuple[Cell, ...]:
    """How many failed again, and how near the others came."""
    rate, nearest = found.rate, found.smallest_robustness_m
    if rate is None:
        return (0, 0, nearest)
    return (rate.k, rate.n, nearest)


def replay_rows(proven: list[Proven]) -> Iterator[tuple[Cell, ...]]:
    """A row for each replay that has a result."""
    for found, proof_of in proven:
        for scenario in proof_of.scenarios:
            yield from (
                list_proof(found, each) for each in scenario.replays if each.outcome is not None
            )


def list_proof(found: Analysed, each: ReplayedNoise) -> tuple[Cell, ...]:
    """One replay."""
    who = (found.subject.id, each.campaign, each.index, each.what.value, each.mode + 1)
    likely = (each.log_probability, each.expected_log_probability)
    return (*who, each.reproduced, each.robustness_m, *likely)


VARIANCE_TABLE = "explained-variance"


VARIANCE_COLUMNS = (
    ("campaign", "Campaign"),
    ("component", "Component"),
    ("share", "Share of the variance", "share"),
    ("cumulative", "Cumulative", "share"),
)


VARIANCE_WORDS = (
    "If a few components explain much of the variance, the failures are alike; bars are single "
    "components, lines their sum so far."
)


def make_variance(material: Material) -> page.ReportPart | None:
    """The explained variance of every campaign that was analysed."""
    found = [each for each in list_analysed(material) if len(each.result.explained)]
    if not found:
        return None
    rows = [row for each in found for row in list_component_rows(each)]
    return page.ReportPart(
        name="variance",
        title="Explained variance",
        words=(VARIANCE_WORDS,),
        tables=(
            page.make_table(
                VARIANCE_TABLE, "Variance explained by the components", VARIANCE_COLUMNS, rows
            ),
        ),
        pictures=tuple(
            (describe_variance_picture(name, group), draw_variance(group))
            for name, group in page.name_groups(found, VARIANCE_TABLE)
        ),
    )


def list_component_rows(found: Analysed) -> Iterator[tuple[Cell, ...]]:
    """Yield a row for each component."""
    explained = found.result.explained.astype(float)
    for number, (share, so_far) in enumerate(zip(explained, np.cumsum(explained), strict=True), 1):
        yield (found.subject.id, number, float(share), float(so_far))


def describe_variance_picture(name: str, group: tuple[Analysed, ...]) -> ReportPicture:
    """Return the description of the picture of explained variance."""
    sentences = (
        f"Campaign {each.subject.label}: the first component explains "
        f"{format_share(float(each.result.explained[0]))}, all {len(each.result.explained)} "
        f"together {format_share(float(each.result.explained.sum()))}."
        for each in group
    )
    return ReportPicture(
        name=name,
        title="Explained variance",
        alternative=" ".join(sentences),
        table=VARIANCE_TABLE,
        campaigns=tuple(each.subject.id for each in group),
    )


def draw_variance(group: tuple[Analysed, ...]) -> svg.Drawing:
    """Bars side by side, and their sums."""
    width = 0.8 / len(group)

    def draw(figure: "Figure") -> None:
        axes = figure.subplots()
        for place, each in enumerate(group):
            look, explained = (
                svg.pick_mark(each.subject.place),
                100.0 * each.result.explained.astype(float),
            )
            at = np.arange(1, len(explained) + 1) + (place - (len(group) - 1) / 2.0) * width
            axes.bar(
                at,
                explained,
                0.9 * width,
                facecolor="white",
                edgecolor=look.colour,
                hatch=look.hatch,
                label=each.subject.label,
            )
            axes.plot(at, np.cumsum(explained), **look.style)
        axes.set_xticks(range(1, 1 + max(len(each.result.explained) for each in group)))
        axes.set_xlabel("component")
        axes.set_ylabel("share of the variance [%]")
        axes.set_ylim(0.0, 100.0)
        page.draw_legend(axes)

    return svg.Drawing(draw, 2.9 + 0.16 * len(group))


TRAINING_TABLE = "training"


SPACE_SIGMA = 3.0


TRAINING_WORDS = (
    "The mean noise of the failures in each tenth of a campaign's episodes, the first tenth at the "
    f"top. Lines stand {SPACE_SIGMA:g} sigma apart, each on its own zero. A method that learns "
    "settles on a pattern; one that does not learn shows chance."
)


def make_training(material: Material) -> page.ReportPart | None:
    """The training of every campaign that was analysed."""
    found = [each for each in list_analysed(material) if each.result.training]
    if not found:
        return None
    channels = list_channels(found)
    columns = (
        ("campaign", "Campaign"),
        ("interval", "Interval"),
        ("start", "From", "share"),
        ("end", "to", "share"),
        ("failures", "Failures"),
        ("step", "Step"),
        *((channel, f"Mean {channel} noise", "sigma") for channel in channels),
    )
    rows = [row for each in found for row in list_training_steps(each, channels)]
    return page.ReportPart(
        name="training",
        title="Disturbances over the training",
        words=(TRAINING_WORDS,),
        tables=(
            page.make_table(
                TRAINING_TABLE, "Mean noise of the failures by interval", columns, rows
            ),
        ),
        pictures=tuple((describe_training_picture(each), draw_training(each)) for each in found),
    )


def list_training_steps(found: Analysed, channels: Sequence[str]) -> Iterator[tuple[Cell, ...]]:
    """A row for each step of each interval that has a failure."""
    for number, each in enumerate(found.result.training, start=1):
        who = (found.subject.id, number, each.start, each.end, each.failures)
        for step, z in enumerate(each.mean.astype(float) if each.failures else ()):
            cells = [(float(value),) for value in z]
            yield (*who, step, *arrange_by_channel(cells, found.result.channels, channels))


def describe_training_picture(found: Analysed) -> ReportPicture:
    """How the mean noise moved, in words."""
    sentences = (
        f"{format_share(each.start)} to {format_share(each.end)}: {each.failures} failures"
        for each in found.result.training
    )
    return ReportPicture(
        name=f"training-{found.name}",
        title=f"Disturbances over the training, campaign {found.subject.label}",
        alternative=f"Failures by interval: {'; '.join(sentences)}.",
        table=TRAINING_TABLE,
        campaigns=(found.subject.id,),
        note=found.channels_note,
    )


def draw_training(found: Analysed) -> svg.Drawing:
    """A line for each interval, from top to bottom; a panel for each channel."""
    channels = found.drawn_channels

    def draw(figure: "Figure") -> None:
        (panels,) = page.draw_panels(figure, 1, len(channels))
        for axes, (way, channel) in zip(panels, channels, strict=True):
            draw_training_lines(axes, found, way)
            axes.set_title(f"{channel} noise")
        page.title_panels(
            [panels], "time [s]" if found.step_s else "step", "episodes of the campaign"
        )
        intervals = found.result.training
        panels[0].set_yticks(
            [-SPACE_SIGMA * row for row in range(len(intervals))],
            [f"{100.0 * each.start:g}–{100.0 * each.end:g} %" for each in intervals],
        )

    return svg.Drawing(draw, 4.6 * page.count_panel_rows(len(channels)))


def draw_training_lines(axes: "Axes", found: Analysed, way: int) -> None:
    """The mean noise of one channel in each interval."""
    for row, each in enumerate(found.result.training):
        zero = -SPACE_SIGMA * row
        axes.axhline(zero, color=svg.MUTED, linewidth=0.6, linestyle=(0, (1.2, 1.6)))
        if each.failures:
            at = np.arange(len(each.mean)) * (found.step_s or 1.0)
            axes.plot(at, zero + each.mean[:, way], color=svg.INK, linewidth=1.2)
    axes.grid(visible=False, axis="y")
