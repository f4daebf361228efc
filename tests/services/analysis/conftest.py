"""Failures with known modes, and failures with none."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest

from eigenfail.values.records import Failures

HORIZON = 100
SIZES = (90, 60, 40)


class Planted(NamedTuple):
    """Failures around known modes: shape (3, HORIZON, 2), each row's mode in `labels`."""

    failures: Failures
    modes: np.ndarray
    labels: np.ndarray


def planted_modes() -> np.ndarray:
    modes = np.zeros((len(SIZES), HORIZON, 2))
    modes[0, 20:35, 0] = 2.5
    modes[1, 50:65, 1] = -2.5
    modes[2, 70:85, 0] = -2.0
    return modes


def as_failures(noise: list[np.ndarray]) -> Failures:
    indices = tuple(range(3, 3 + 2 * len(noise), 2))
    return Failures(indices, tuple(z.astype(np.float32) for z in noise))


@pytest.fixture(scope="session")
def plant() -> Callable[[int, float], Planted]:
    def make(seed: int, spread: float) -> Planted:
        generator = np.random.default_rng(seed)
        modes = planted_modes()
        labels = generator.permutation(np.repeat(range(len(SIZES)), SIZES))
        noise = modes[labels] + spread * generator.standard_normal((len(labels), HORIZON, 2))
        return Planted(as_failures(list(noise)), modes, labels)

    return make


@pytest.fixture(scope="session")
def structureless() -> Callable[[int], Failures]:
    """Coloured noise of differing length: much in common, and no modes."""

    def make(seed: int) -> Failures:
        generator = np.random.default_rng(seed)
        noise = generator.standard_normal((120, HORIZON, 2))
        for step in range(1, HORIZON):
            noise[:, step] = 0.9 * noise[:, step - 1] + 0.44 * noise[:, step]
        lengths = generator.integers(40, HORIZON + 1, len(noise))
        return as_failures([z[:steps] for z, steps in zip(noise, lengths, strict=True)])

    return make


@pytest.fixture(scope="session")
def failures_of() -> Callable[[list[np.ndarray]], Failures]:
    return as_failures
