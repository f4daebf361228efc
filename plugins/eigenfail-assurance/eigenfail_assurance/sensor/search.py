"""The search for the largest error of a sensor at which P(failure) stays at or below a target.

P(failure) is assumed to grow with the error, and bounded at anchors: by a campaign at each. An
anchor meets the target if its upper bound is at or below the target, and does not if its lower
bound is above. The largest one that meets it is found by bisection of a grid that is fixed
beforehand.

**Confidence.** A search of n tests at most gives each test the error (1 - confidence) ÷ n
(Bonferroni; Dunn 1961, J. Am. Stat. Assoc. 56, 52-64). The statement is wrong if an anchor beyond
the true limit seems to meet the target. As long as none does, the bisection takes one path among
such anchors, whatever is found below the limit: an anchor there that is missed leads away from
them. So at most n tests can make the statement wrong, and they may depend on each other, as
campaigns of one seed do. Testing from the smallest error on would need no division, but a campaign
for each point of the grid, and those with the rarest failures cost most. If an anchor is undecided,
a second bisection looks for the smallest error that misses the target; targets met in this second
bisection do not count.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from enum import StrEnum
from itertools import permutations
from math import ceil, log, log2
from typing import Annotated

import msgspec

from eigenfail.errors import InvalidValue
from eigenfail.values.estimates import Interval
from eigenfail_assurance.sensor.scaling import SCALE, Multiples

GRID_DIGITS = 4
"""Significant digits of the multiples of a grid, so that they can be quoted in full."""

FEW_FAILING = 0.1
"""Share of failures up to which a campaign without a number leads to larger errors."""

NARROWEST = 1.01
"""Ratio of the ends of a range, at least."""

Multiple = Annotated[float, msgspec.Meta(ge=1e-3, le=1e3)]


class MultipleRange(msgspec.Struct, frozen=True):
    """Range of multiples of an error that are searched.

    Attributes:
        low: smallest multiple; it is always tried.
        high: largest multiple; it is always tried if the smallest does not rule it out.
        tolerance: neighbours on the grid differ by this share at most.
    """

    low: Multiple = 0.5
    high: Multiple = 2.0
    tolerance: Annotated[float, msgspec.Meta(ge=0.01, le=1.0)] = 0.05

    def __post_init__(self) -> None:
        """Raise InvalidValue for a range that is empty or too narrow for two multiples."""
        if not self.low * NARROWEST <= self.high:
            raise InvalidValue("low", f"{self.low:g} is not below the high end, {self.high:g}.")

    def make_grid(self, points: int | None = None) -> tuple[float, ...]:
        """Return multiples with equal ratios, both ends included: `points`, or by the tolerance."""
        ratio = self.high / self.low
        steps = points - 1 if points else max(ceil(log(ratio) / log(1.0 + self.tolerance)), 1)
        made = (self.low * ratio ** (place / steps) for place in range(steps + 1))
        return tuple(dict.fromkeys(float(f"{each:.{GRID_DIGITS}g}") for each in made))


class RequirementQuestion(msgspec.Struct, frozen=True, kw_only=True):
    """Question about a sensor: channels, target and budget.

    Attributes:
        target: largest probability of failure that is accepted.
        channels: whose errors are scaled: each alone, and two of them jointly.
        within: multiples of their own size that are searched.
        confidence: probability that a statement on one channel holds, and that all statements on
            the frontier hold.
        points: points of the frontier, the multiples of the first channel; 0 for none.
    """

    target: Annotated[float, msgspec.Meta(gt=0.0, lt=1.0)]
    channels: tuple[str, ...] = (SCALE,)
    within: MultipleRange = MultipleRange()
    confidence: Annotated[float, msgspec.Meta(ge=0.5, lt=1.0)] = 0.95
    points: Annotated[int, msgspec.Meta(ge=0, le=50)] = 3

    def __post_init__(self) -> None:
        """Raise InvalidValue for a frontier of one point."""
        if self.points == 1:
            raise InvalidValue("points", "1 is no frontier.", "Give 2 or more, or 0 for none.")

    @property
    def tests(self) -> int:
        """Number of tests that a search on one channel takes at most until its limit is found."""
        return 2 + ceil(log2(len(self.within.make_grid()) - 1))

    @property
    def test_error(self) -> float:
        """Error of one test of a search on one channel."""
        return (1.0 - self.confidence) / self.tests

    @property
    def has_frontier(self) -> bool:
        """True if two channels are searched jointly."""
        return self.points > 0 and len(self.channels) == 2


class AnchorVerdict(StrEnum):
    """The verdict of a campaign on the target."""

    MET = "met"
    NOT_MET = "not met"
    UNDECIDED = "undecided"
    UNKNOWN = "no number"


class Anchor(msgspec.Struct, frozen=True, kw_only=True):
    """P(failure) at some multiples of the errors.

    Attributes:
        multiples: by channel.
        campaign: id of the campaign.
        episodes: number of its completed episodes.
        failures: number of failures among them.
        probability: P(failure); None if the estimate is missing.
        bounds: lower and upper bound of P(failure), each with the error of one test.
        verdict: verdict of the bounds on the target.
        problem: why numbers are missing; empty otherwise.
    """

    multiples: dict[str, float]
    campaign: int
    episodes: int
    failures: int
    probability: float | None
    bounds: Interval
    verdict: AnchorVerdict
    problem: str = ""

    @property
    def leads_up(self) -> bool:
        """True if the search continues at larger errors.

        If a method looks for failures and finds few, the reason is that failures are too rare.
        """
        is_rare = self.failures <= FEW_FAILING * self.episodes
        unseen = self.verdict is AnchorVerdict.UNKNOWN and is_rare
        return unseen or self.verdict is AnchorVerdict.MET

    def is_within(self, other: "Anchor") -> bool:
        """Return whether every error is at most as large as at another anchor."""
        names = self.multiples.keys() | other.multiples.keys()
        return all(
            self.multiples.get(each, 1.0) <= other.multiples.get(each, 1.0) for each in names
        )


class Contradiction(msgspec.Struct, frozen=True):
    """Two anchors at which P(failure) falls as errors grow, by their bounds."""

    smaller: Anchor
    larger: Anchor


class ErrorLimit(msgspec.Struct, frozen=True, kw_only=True):
    """The largest error of one channel, in multiples of the size that the channel states.

    Attributes:
        channel: name of the channel.
        beside: multiples of other channels that are kept.
        largest: largest multiple that was shown to meet the target; None if none was.
        not_met_from: smallest multiple that was shown not to meet it; None if none was.
        undecided: multiples between, which show neither.
        at_high_end: whether `largest` is the end of the search.
        tests: multiples in the order of the tests.
    """

    channel: str
    beside: dict[str, float]
    largest: float | None
    not_met_from: float | None
    undecided: tuple[float, ...]
    at_high_end: bool
    tests: tuple[float, ...]


class RequirementAnswer(msgspec.Struct, frozen=True, kw_only=True):
    """Requirement on a sensor, as far as the budget shows it.

    Attributes:
        question: the question.
        limits: largest error of each channel, the others as in the campaign.
        frontier: largest error of the second channel at multiples of the first one.
        anchors: all anchors of the searches, in each search sorted by the multiple of its channel.
        contradictions: pairs of them that contradict that P(failure) grows with errors.
    """

    question: RequirementQuestion
    limits: tuple[ErrorLimit, ...]
    frontier: tuple[ErrorLimit, ...]
    anchors: tuple[Anchor, ...]
    contradictions: tuple[Contradiction, ...]


Measure = Callable[[Multiples, float], Anchor]
"""Bounds P(failure) at multiples of the errors, each bound with the given error."""


def find_limits(question: RequirementQuestion, measure: Measure) -> RequirementAnswer:
    """Search on each channel alone and, if the question has a frontier, on two channels jointly."""
    alone = [_Search(question, each, {}) for each in question.channels]
    jointly = list(_plan_frontier(question))
    for search in alone:
        search.run(measure, question.test_error)
    for search in jointly:
        search.run(measure, question.test_error / len(jointly))
    anchors = [anchor for search in (*alone, *jointly) for anchor in search.sorted_anchors]
    contradictions = tuple(find_contradictions(anchors))
    return RequirementAnswer(
        question=question,
        limits=tuple(search.conclude(anchors, contradictions) for search in alone),
        frontier=tuple(search.conclude(anchors, contradictions) for search in jointly),
        anchors=tuple(anchors),
        contradictions=contradictions,
    )


def _plan_frontier(question: RequirementQuestion) -> Iterator["_Search"]:
    if question.has_frontier:
        kept, searched = question.channels
        for multiple in question.within.make_grid(question.points):
            yield _Search(question, searched, {kept: multiple})


def find_contradictions(anchors: Iterable[Anchor]) -> Iterator[Contradiction]:
    """Yield the pairs of anchors whose bounds say that P(failure) falls as errors grow."""
    for one, other in permutations(anchors, 2):
        if one.is_within(other) and one.bounds.low > other.bounds.high:
            yield Contradiction(one, other)


class _Search:
    """A bisection of the multiples of one channel.

    Attributes:
        anchors: those that were tried, in order.
    """

    def __init__(
        self, question: RequirementQuestion, channel: str, beside: dict[str, float]
    ) -> None:
        self._grid = question.within.make_grid()
        self._channel = channel
        self._beside = beside
        self.anchors: list[Anchor] = []

    def run(self, measure: Measure, error: float) -> None:
        """Try the ends, then look for the largest that is met and the smallest that is not."""
        last = len(self._grid) - 1
        if not self._try(0, measure, error).leads_up or self._try(last, measure, error).leads_up:
            return
        self._halve(0, last, lambda at: self._try(at, measure, error).leads_up)
        verdicts = {self._grid.index(self._read(each)): each.verdict for each in self.anchors}
        not_met = [at for at, verdict in verdicts.items() if verdict is AnchorVerdict.NOT_MET]
        if not_met:
            open_below = max(at for at in verdicts if at < min(not_met))
            self._halve(
                open_below,
                min(not_met),
                lambda at: self._try(at, measure, error).verdict is not AnchorVerdict.NOT_MET,
            )

    def _halve(self, low: int, high: int, leads_up: Callable[[int], bool]) -> None:
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if leads_up(middle) else (low, middle)

    def _try(self, place: int, measure: Measure, error: float) -> Anchor:
        multiples = {**self._beside, self._channel: self._grid[place]}
        self.anchors.append(measure(multiples, error))
        return self.anchors[-1]

    @property
    def sorted_anchors(self) -> list[Anchor]:
        """The anchors by the multiple of the channel."""
        return sorted(self.anchors, key=self._read)

    def conclude(
        self, anchors: Sequence[Anchor], contradictions: Sequence[Contradiction]
    ) -> ErrorLimit:
        """Return the limit that the anchors of all searches allow for, at its cautious end."""
        own = self.sorted_anchors
        not_met = [each for each in own if each.verdict is AnchorVerdict.NOT_MET]
        refuting = [each for each in anchors if each.verdict is AnchorVerdict.NOT_MET]
        refuting += [each.larger for each in contradictions]
        # What is met beyond an error that led down was tried because of it, and not beforehand.
        refuting += [each for each in own if not each.leads_up]
        met = [
            self._read(each)
            for each in own
            if each.verdict is AnchorVerdict.MET
            and not any(other.is_within(each) for other in refuting)
        ]
        largest = max(met, default=None)
        not_met_from = min(map(self._read, not_met), default=None)
        return ErrorLimit(
            channel=self._channel,
            beside=self._beside,
            largest=largest,
            not_met_from=not_met_from,
            undecided=tuple(
                at
                for at in map(self._read, own)
                if (largest is None or at > largest) and (not_met_from is None or at < not_met_from)
            ),
            at_high_end=largest == self._grid[-1],
            tests=tuple(map(self._read, self.anchors)),
        )

    def _read(self, anchor: Anchor) -> float:
        return anchor.multiples[self._channel]
