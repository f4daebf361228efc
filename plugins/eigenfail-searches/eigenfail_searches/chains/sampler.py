"""Samples of p(z | failure): Markov chains that move from failure to failure.

Every move leaves the standard normal p(z) unchanged and is reversible with respect to it, and it is
accepted where the noise that it proposes still fails. The chains are then reversible with respect
to p(z | failure), whatever the sizes of the moves, as long as these do not change (Metropolis et
al. 1953; for pCN Cotter et al. 2013, Statistical Science 28, 424–446; for components Au and Beck
2001, Probabilistic Engineering Mechanics 16, 263–277).

An episode ends with its failure, so that noise after that step has the distribution p(z) given the
noise before it: it is redrawn before each move, which needs no episode (a Gibbs step).

Chains do not show the regions of failures that no move reaches from their starts; `mixing` says
whether they have forgotten their starts.
"""

from collections.abc import Callable, Mapping
from enum import StrEnum
from math import exp, sqrt
from types import MappingProxyType

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.values.arrays import Floats
from eigenfail_services.statistics.batches import Array, divide_chains

Mask = NDArray[np.bool_]
Steps = NDArray[np.int64]

SHORTEST_WINDOW, LONGEST_WINDOW = 3, 15
"""Steps of a window that is redrawn."""

LONGEST_SHIFT = 10
"""Steps by which a segment is shifted at most. From 7 to 17 about as many shifts are accepted."""

MOST_SUMS = 5
SHORTEST_SUM, LONGEST_SUM = 5, 30
"""Weighted sums of the noise that a move redraws at most, and the steps of each."""

SHORTEST_DETAIL, LONGEST_DETAIL = 10, 50
"""Steps of a window whose detail is redrawn."""

FEWEST_DETAILED = 3
"""Steps that have more than a mean and a trend."""

SMALLEST_SIZE = 0.005


class MoveKind(StrEnum):
    """Ways in which a chain may move."""

    REDRAW = "redraw"
    WINDOW = "window"
    PCN = "pcn"
    SHIFT = "shift"
    SMOOTH = "smooth"
    DETAIL = "detail"


FIRST_SIZES: Mapping[str, float] = MappingProxyType({MoveKind.REDRAW: 0.1, MoveKind.PCN: 0.2})
"""Sizes of the moves that have one, before they are adapted."""


def redraw_components(z: Array, size: float, rng: np.random.Generator) -> Array:
    """Return noise of which each value was redrawn with probability `size`; at least one was."""
    chosen = rng.random(z.shape) < size
    chosen.flat[rng.integers(chosen.size)] = True
    return np.where(chosen, rng.standard_normal(z.shape), z)


def redraw_window(z: Array, _size: float, rng: np.random.Generator) -> Array:
    """Return noise of which 3 to 15 successive steps of one channel or all were redrawn."""
    window = _draw_window(len(z), SHORTEST_WINDOW, LONGEST_WINDOW, rng)
    moved = z.copy()
    inside = moved[window, _choose_channels(z.shape[1], rng)]
    inside[:] = rng.standard_normal(inside.shape)
    return moved


def step_pcn(z: Array, size: float, rng: np.random.Generator) -> Array:
    """Return sqrt(1 − s²) · z + s · e with e ~ N(0, I) and the size s: preconditioned CN."""
    kept: Array = sqrt(1.0 - size**2) * z
    return kept + size * rng.standard_normal(z.shape)


def shift_segment(z: Array, size: float, rng: np.random.Generator) -> Array:
    """Return noise of which a segment of one channel or all was rotated by up to 10 steps.

    It moves what happens in the segment to another time, which no small change of its values does.
    The values are those of before in another order, which is as likely, and a rotation back has the
    probability of that forth. Noise of a single step is redrawn.
    """
    if len(z) == 1:
        return redraw_window(z, size, rng)
    first, last = np.sort(rng.choice(len(z), 2, replace=False)).tolist()
    # Less than the segment is long: a full turn changes nothing, and would count as a failure.
    shift = int(rng.integers(1, min(LONGEST_SHIFT, last - first) + 1)) * int(rng.choice((-1, 1)))
    moved = z.copy()
    segment = moved[first : last + 1, _choose_channels(z.shape[1], rng)]
    segment[:] = np.roll(segment, shift, axis=0)
    return moved


def redraw_sums(z: Array, _size: float, rng: np.random.Generator) -> Array:
    """Return noise of which 1 to 5 weighted sums of one channel over 5 to 30 steps were redrawn.

    A planner filters what it senses: sums over many steps matter to it, and moves that redraw
    single steps hardly change them. With weights u of length 1, here half a sine wave, the sum
    u·z ~ N(0, 1) is independent of the rest of z: drawing it anew, z' = z + (e − u·z) u, is a Gibbs
    step of p(z), and is reversible. A sequence of such steps is as likely as its reverse, since
    windows and channels are drawn independently of z and of each other: the whole is reversible
    too. Moves that are larger in some directions than in others: Cui, Law and Marzouk 2016, Journal
    of Computational Physics 304, 109–137.
    """
    moved = z.copy()
    for _ in range(int(rng.integers(1, MOST_SUMS + 1))):
        window = _draw_window(len(z), SHORTEST_SUM, LONGEST_SUM, rng)
        column = moved[window, rng.integers(z.shape[1])]
        u = np.sin(np.pi * (np.arange(len(column)) + 0.5) / len(column))
        u /= np.linalg.norm(u)
        column += (rng.standard_normal() - u @ column) * u
    return moved


def redraw_detail(z: Array, size: float, rng: np.random.Generator) -> Array:
    """Return noise of which 10 to 50 steps were redrawn but for each channel's mean and trend.

    The counterpart of `redraw_sums`: what a filter passes stays, and the rest is redrawn, which is
    independent of it under p(z). Noise of one step or two has no detail: a window is redrawn.
    """
    if len(z) < FEWEST_DETAILED:
        return redraw_window(z, size, rng)
    window = _draw_window(len(z), SHORTEST_DETAIL, LONGEST_DETAIL, rng, FEWEST_DETAILED)
    moved = z.copy()
    inside = moved[window]
    kept = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, len(inside)), 2))[0]
    drawn = rng.standard_normal(inside.shape)
    inside[:] = drawn + kept @ (kept.T @ (inside - drawn))
    return moved


def _choose_channels(channels: int, rng: np.random.Generator) -> slice:
    """Return the columns of all channels, or of one of them, each as likely as the others."""
    chosen = int(rng.integers(1 + channels))
    return slice(chosen - 1, chosen) if chosen else slice(0, channels)


def _draw_window(
    steps: int, shortest: int, longest: int, rng: np.random.Generator, inside: int = 1
) -> slice:
    """Return a window of the noise that has at least `inside` steps of it."""
    width = int(rng.integers(min(shortest, steps), min(longest, steps) + 1))
    # Windows reach beyond both ends, so that the first and last steps are redrawn as often.
    first = int(rng.integers(inside - width, steps - inside + 1))
    return slice(max(first, 0), first + width)


MOVES: Mapping[MoveKind, Callable[[Array, float, np.random.Generator], Array]] = MappingProxyType(
    {
        MoveKind.REDRAW: redraw_components,
        MoveKind.WINDOW: redraw_window,
        MoveKind.PCN: step_pcn,
        MoveKind.SHIFT: shift_segment,
        MoveKind.SMOOTH: redraw_sums,
        MoveKind.DETAIL: redraw_detail,
    }
)


class MoveMix(msgspec.Struct, frozen=True, kw_only=True):
    """How chains move.

    Attributes:
        weights: relative number of moves of each kind.
        acceptance: share of the moves that is to be accepted, by the choice of their sizes.
        adapted: number of moves of each chain after which the sizes stay as they are.
    """

    weights: Mapping[MoveKind, float]
    acceptance: float
    adapted: int


class ChainSampler:
    """Moves chains of failures side by side; what it draws depends on its seed and its state only.

    Groups of chains take turns, a move each, and a group moves on without the results of the
    others. The sizes are those of all groups; they stay as they are from the first move on that
    does not change them, so that no sample after burn-in is of moves whose size follows the chains.

    Args:
        z: noise of a failure of each chain, shape (chains, steps, channels); values after its end
            do not count.
        ends: number of steps to the failure of each chain, shape (chains,).
        mix: how the chains move.
        seed: seed of every draw.
        parallel: episodes that are to run at a time; None for a single group of chains.

    Attributes:
        z: noise of the present failures. [sigma]
        ends: their numbers of steps.
        sizes: present size of each kind of move that has one.
        groups: numbers of the chains in each group.
        tried: number of moves of groups that were tried.
        opened: number of moves of groups that were proposed and not yet tried.
    """

    def __init__(
        self, z: Floats, ends: Steps, mix: MoveMix, seed: int, parallel: int | None = None
    ) -> None:
        self.z, self.ends = z, ends
        self.sizes = dict(FIRST_SIZES)
        self.groups = divide_chains(len(z), parallel)
        self.tried = self.opened = 0
        self._mix = mix
        self._seed = seed

    @property
    def moved(self) -> int:
        """Number of moves of each chain that were tried."""
        return self.tried // len(self.groups)

    def propose(self, chains: int) -> Floats:
        """Return the noise to which the first chains of the next group would move.

        Args:
            chains: number of them at most; the shape is (up to chains, steps, channels).
        """
        move, group = divmod(self.tried + self.opened, len(self.groups))
        self.opened += 1
        # Streams of other groups than the first follow that of the kinds.
        rng = np.random.default_rng([self._seed, move, *([1 + group] if group else [])])
        kinds = self._draw_kinds(move)
        rows = self.groups[group][:chains].tolist()
        return np.stack([self._move(i, kinds[i], rng) for i in rows]).astype(np.float32)

    def _move(self, chain: int, kind: MoveKind, rng: np.random.Generator) -> Array:
        z = self.z[chain].astype(np.float64)
        tail = z[self.ends[chain] :]
        tail[:] = rng.standard_normal(tail.shape)
        return MOVES[kind](z, self.sizes.get(kind, 0.0), rng)

    def _draw_kinds(self, move: int) -> list[MoveKind]:
        # A generator of its own: the kinds are needed again when the results have come.
        rng = np.random.default_rng([self._seed, move, 1])
        kinds = list(MoveKind)
        weights = np.array([self._mix.weights[kind] for kind in kinds])
        drawn = rng.choice(len(kinds), len(self.z), p=weights / weights.sum())
        return [kinds[place] for place in drawn.tolist()]

    def find_tried(self, chains: int) -> NDArray[np.intp]:
        """Return the numbers of the first chains of the group whose results come next."""
        return self.groups[self.tried % len(self.groups)][:chains]

    def accept(self, z: Floats, ends: Steps, failed: Mask, ran: Mask) -> None:
        """Move the chains whose proposals failed; the others stay where they are.

        Args:
            z: noise that was proposed to the first chains of a group, shape (n, steps, channels).
            ends: numbers of steps after which these episodes ended, shape (n,).
            failed: which of them failed.
            ran: which of them were completed; the others say nothing about the sizes.
        """
        rows = self.find_tried(len(z))
        self.z[rows[failed]] = z[failed]
        self.ends[rows[failed]] = ends[failed]
        if self.tried <= (self._mix.adapted - 1) * len(self.groups):
            self._adapt(rows, failed, ran)
        self.tried += 1
        # A state of earlier releases does not count the move that was open.
        self.opened = max(self.opened - 1, 0)

    def _adapt(self, rows: NDArray[np.intp], failed: Mask, ran: Mask) -> None:
        """Change the size of each kind of move towards the acceptance (Robbins and Monro 1951)."""
        kinds = np.array(self._draw_kinds(self.moved))[rows]
        gain = 1.0 / len(self.groups)
        for kind, size in self.sizes.items():
            tried = failed[ran & (kinds == kind)]
            if tried.size:
                missed = float(tried.mean()) - self._mix.acceptance
                change = gain * missed / sqrt(1.0 + self.moved)
                self.sizes[kind] = min(max(size * exp(change), SMALLEST_SIZE), 1.0)
