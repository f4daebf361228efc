"""Failures as they come from the store, portion by portion, put side by side."""

import hashlib
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from eigenfail.values import AnalysisSettings, Floats
from eigenfail.values.records import Failures
from eigenfail_services.analysis.alignment import ALIGNMENTS, COLUMNS, Aligned
from eigenfail_services.analysis.refusals import check_noise, nothing_to_analyse


class Portion(NamedTuple):
    """Some failures of a campaign."""

    campaign: int
    failures: Failures


class Placed(NamedTuple):
    """A portion put side by side, and what each of its failures is sorted by."""

    keys: list[tuple[bytes, int, int]]
    steps: list[int]
    noise: Floats


def gather(portions: Iterable[Portion], horizon: int, settings: AnalysisSettings) -> Aligned:
    """Put failures side by side, in an order that depends on nothing but their noise.

    So the modes do not depend on when a failure was found, and sums round alike.

    Args:
        portions: of no episode twice.
        horizon: steps of a full episode.
        settings: how to align, and which axes.

    Raises:
        InvalidValue: there is no failure, or one that does not fit the horizon.
    """
    parts = [placed(portion, horizon, settings.align) for portion in portions]
    keys = [key for part in parts for key in part.keys]
    if not keys:
        raise nothing_to_analyse()
    order = sorted(range(len(keys)), key=keys.__getitem__)
    _, campaigns, episodes = zip(*(keys[row] for row in order), strict=True)
    steps = np.array([steps for part in parts for steps in part.steps])
    noise = np.concatenate([part.noise for part in parts])
    del parts
    return Aligned(
        campaigns=np.array(campaigns),
        episodes=np.array(episodes),
        steps=steps[order],
        noise=noise[order],
        alignment=ALIGNMENTS[settings.align],
        columns=COLUMNS[settings.axes],
    )


def placed(portion: Portion, horizon: int, how: str) -> Placed:
    """A portion put side by side.

    Args:
        portion: of one campaign.
        horizon: steps of a full episode.
        how: a name in `ALIGNMENTS`.

    Raises:
        InvalidValue: the noise of a failure does not fit the horizon.
    """
    campaign, failures = portion
    noise = np.zeros((len(failures.noise), horizon, 2), np.float32)
    for row, z, index in zip(noise, failures.noise, failures.indices, strict=True):
        check_noise(z, index, horizon)
        row[ALIGNMENTS[how].place(len(z), horizon)] = z
    keys = [
        (hashlib.blake2b(z.tobytes(), digest_size=16).digest(), campaign, index)
        for z, index in zip(failures.noise, failures.indices, strict=True)
    ]
    return Placed(keys, [len(z) for z in failures.noise], noise)
