"""The charts of an analysis."""

from collections.abc import Iterable, Iterator

import numpy as np

from eigenfail.values import AXES, AnalysisResult, Floats, Moment
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.charts import MOST_ROWS, Chart, rounded

MOST_POINTS = 5_000


def eigenfailure_chart(result: AnalysisResult) -> Chart:
    """The noise that stands for each mode."""
    modes = [mode.eigenfailure for mode in result.modes]
    bands = [mode.band for mode in result.modes if mode.band is not None]
    return Chart(
        id="eigenfailure-chart",
        kind="eigenfailures",
        title="Eigenfailures",
        caption="The centre of each mode, taken back to noise over time [sigma]."
        + (" Bands: from 10 to 90 % of the noise of its failures at each step." if bands else ""),
        data={
            **{axis: [numbers(z[:, way]) for z in modes] for way, axis in enumerate(AXES)},
            "bands": {axis: limits(bands, way) for way, axis in enumerate(AXES)},
        },
        columns=(
            "Step",
            *(f"Mode {mode + 1} {axis}" for mode in range(len(modes)) for axis in AXES),
            *band_columns(len(bands)),
        ),
        rows=by_step(np.concatenate([*modes, *(side for band in bands for side in band)], axis=1)),
    )


def limits(bands: Iterable[Floats], way: int) -> list[list[list[float | None]]]:
    """The lower and the upper limit of each mode's band along an axis."""
    return [[numbers(side[:, way]) for side in band] for band in bands]


def band_columns(count: int) -> Iterator[str]:
    """Names of the columns of bands, in the order of their numbers."""
    for mode in range(count):
        for share in ("10 %", "90 %"):
            yield from (f"Mode {mode + 1} {axis} {share}" for axis in AXES)


def scores_chart(result: AnalysisResult, campaign: int) -> Chart:
    """The failures in PCA space; `campaign` is theirs unless the result names others."""
    chosen = evenly(len(result.episodes), MOST_POINTS)
    second = 1 if result.scores.shape[1] > 1 else 0
    centres = np.stack([mode.centre for mode in result.modes])
    addresses = places(result, campaign)
    return Chart(
        id="scores-chart",
        kind="scores",
        title="Failures in PCA space",
        caption="Each failure by its first two scores; colour and shape tell the mode, + its mean.",
        data={
            "episode": [addresses[row] for row in chosen],
            "mode": [result.labels[row] for row in chosen],
            "x": numbers(result.scores[chosen, 0]),
            "y": numbers(result.scores[chosen, second]),
            "centres": [numbers(centre[[0, second]]) for centre in centres],
        },
        columns=("Episode", "Mode", "First score", "Second score"),
        rows=tuple(
            (
                addresses[row],
                str(result.labels[row] + 1),
                formats.number(float(result.scores[row, 0])),
                formats.number(float(result.scores[row, second])),
            )
            for row in chosen[:MOST_ROWS]
        ),
        note=f"The first {MOST_ROWS}." if len(chosen) > MOST_ROWS else "",
    )


def explained_chart(result: AnalysisResult) -> Chart:
    """How much of the failures' variance the components keep."""
    cumulated = np.cumsum(result.explained)
    return Chart(
        id="explained-chart",
        kind="explained",
        title="Explained variance",
        caption="Share of the variance by component, and cumulated.",
        data={
            "share": numbers(100.0 * result.explained),
            "cumulated": numbers(100.0 * cumulated),
        },
        columns=("Component", "Share", "Cumulated"),
        rows=tuple(
            (str(place + 1), formats.percent(float(share)), formats.percent(float(so_far)))
            for place, (share, so_far) in enumerate(zip(result.explained, cumulated, strict=True))
        ),
    )


def influence_chart(result: AnalysisResult) -> Chart:
    """When noise matters."""
    return Chart(
        id="influence-chart",
        kind="influence",
        title="Influence over time",
        caption="How much noise at each step matters: components weighted by explained variance. "
        "Marks: the moments of greatest influence.",
        data={
            **{axis: numbers(result.influence[:, way]) for way, axis in enumerate(AXES)},
            "moments": [marked(each) for each in result.moments],
        },
        columns=("Step", *(axis.capitalize() for axis in AXES)),
        rows=by_step(result.influence),
    )


def marked(found: Moment) -> dict[str, object]:
    """A moment as it is drawn."""
    before_s = found.before_collision_s
    told = "" if before_s is None else f"{before_s:.1f} s before the collision"
    return {"axis": found.axis, "step": found.step, "told": told}


def places(result: AnalysisResult, campaign: int) -> list[str]:
    """Each failure as campaign/episode."""
    owners = result.campaigns or (campaign,) * len(result.episodes)
    return [f"{owner}/{index}" for owner, index in zip(owners, result.episodes, strict=True)]


def by_step(columns: Floats) -> tuple[tuple[str, ...], ...]:
    """A table with a row for each step."""
    return tuple(
        (str(step), *(formats.number(float(value)) for value in row))
        for step, row in enumerate(columns)
    )


def evenly(count: int, most: int) -> list[int]:
    """At most so many of so many positions, spread evenly."""
    taken = min(count, most)
    return [place * count // taken for place in range(taken)] if taken else []


def numbers(values: Iterable[np.floating]) -> list[float | None]:
    """Plain floats of an array."""
    return rounded(float(value) for value in values)
