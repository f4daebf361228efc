"""Failure modes in figures: what their eigenfailures do, and whether they are more than noise."""

from collections.abc import Iterator

import numpy as np
from rich.table import Table

from eigenfail.cli.figures import number, probability
from eigenfail.cli.tables import table
from eigenfail.values import AXES, AnalysisResult, FailureMode, Floats

TELLING_SHARE = 50.0
"""Share of the variance below which eigenfailures are far from the failures they stand for [%]."""

TOO_FEW = "Eigenfailures of so few may not fail again: take more with --components."


def mode_table(campaign: int, result: AnalysisResult) -> Table:
    """The failure modes of a campaign, one a row, counted from 1; disturbances in sigma."""
    figures = ("mode", "failures", "share", *(f"mean {axis}" for axis in AXES))
    peaks = tuple(f"peak {axis}" for axis in AXES)
    told = any(mode.probability for mode in result.modes)
    grid = table(*figures, *peaks, "medoid", *(["probability"] * told), right=figures)
    for number_of_mode, mode in enumerate(result.modes, start=1):
        share = f"{100.0 * mode.failures / len(result.episodes):.0f} %"
        medoid = f"{mode.medoid_campaign or campaign}/{mode.medoid}"
        chance = [probability(mode.probability)] * told
        grid.add_row(
            str(number_of_mode), str(mode.failures), share, *disturbances(mode), medoid, *chance
        )
    return grid


def disturbances(mode: FailureMode) -> tuple[str, ...]:
    """What the eigenfailure of a mode injects: the mean along each axis, then the peaks."""
    axes = mode.eigenfailure.T
    return (*(f"{float(noise.mean()):+.2f}" for noise in axes), *(peak(noise) for noise in axes))


def peak(noise: Floats) -> str:
    """The largest disturbance along one axis, and when."""
    step = int(np.argmax(np.abs(noise)))
    return f"{float(noise[step]):+.2f} at step {step}"


def component_words(result: AnalysisResult) -> str:
    """How much the components explain."""
    share = 100.0 * float(np.sum(result.explained))
    count, failures = len(result.explained), len(result.episodes)
    words = f"{failures} failures; {count} components explain {share:.0f} % of their variance."
    return words if share >= TELLING_SHARE else f"{words} {TOO_FEW}"


def distinctness_words(result: AnalysisResult) -> str:
    """Whether the modes are more than what clustering finds anywhere, and how they were found."""
    return result.diversity.verdict if result.diversity else result.verdict


def diversity_words(result: AnalysisResult) -> Iterator[str]:
    """How the failures spread over modes, and whether these have collapsed."""
    found = result.diversity
    if found is None:
        return
    yield (
        f"The {found.failures} failures differ by {number(found.spread)} sigma; noise of p(x) does "
        "by 1."
    )
    if found.modes > 1:
        seen = ", ".join(map(str, found.coverage))
        yield f"Modes seen after each tenth of the campaign: {seen}."
    if found.warning:
        yield f"Warning: {found.warning}"
