"""The argument as a graph in the Goal Structuring Notation, with a verdict on each claim.

Elements and links follow the GSN Community Standard, version 3 (SCSC-141C, 2021), part 1: goals,
strategies and solutions, joined by SupportedBy; contexts and assumptions, joined by InContextOf; a
goal that is not supported is undeveloped. Verdicts are an addition of this product.

A context or an assumption that several claims share appears once, next to their nearest common
ancestor.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import NamedTuple

import msgspec

from eigenfail_assurance.evidence.assumptions import Surroundings
from eigenfail_assurance.evidence.judgement import ClaimVerdict, SolutionFinding
from eigenfail_assurance.evidence.question import Claim


class ElementKind(StrEnum):
    """Kind of an element of the notation."""

    GOAL = "goal"
    STRATEGY = "strategy"
    SOLUTION = "solution"
    CONTEXT = "context"
    ASSUMPTION = "assumption"


class LinkKind(StrEnum):
    """Kind of a link between two elements."""

    SUPPORTED_BY = "SupportedBy"
    IN_CONTEXT_OF = "InContextOf"


PREFIXES = {
    ElementKind.GOAL: "G",
    ElementKind.STRATEGY: "S",
    ElementKind.SOLUTION: "Sn",
    ElementKind.CONTEXT: "C",
    ElementKind.ASSUMPTION: "A",
}


class ArgumentElement(msgspec.Struct, frozen=True, kw_only=True):
    """An element of the graph.

    Attributes:
        id: unique id in the graph, such as G1.
        kind: kind of element.
        text: statement of the element.
        verdict: of goals and solutions; None of other elements.
        undeveloped: whether a goal is drawn with a diamond, as nothing supports it so far.
        sha256: of a solution: of its file in the bundle. Empty of other elements.
    """

    id: str
    kind: ElementKind
    text: str
    verdict: ClaimVerdict | None = None
    undeveloped: bool = False
    sha256: str = ""


class ArgumentLink(msgspec.Struct, frozen=True, kw_only=True):
    """A link between two elements; it starts at the supported element."""

    source: str
    target: str
    kind: LinkKind


class ArgumentGraph(msgspec.Struct, frozen=True, kw_only=True):
    """The argument for a claim.

    Attributes:
        name: name of the argument.
        verdict: of the top claim.
        elements: the top goal first, each before the elements that support it.
        links: in the order of the elements.
    """

    name: str
    verdict: ClaimVerdict
    elements: tuple[ArgumentElement, ...]
    links: tuple[ArgumentLink, ...]


class JudgedSolution(NamedTuple):
    """A solution for the graph.

    Attributes:
        finding: what its output shows.
        surroundings: contexts and assumptions of its output.
        sha256: of its file in the bundle.
    """

    finding: SolutionFinding
    surroundings: Surroundings
    sha256: str


ClaimPath = tuple[int, ...]
"""Place of a claim: the positions of it and of the claims above it among their siblings."""


def build_graph(name: str, claim: Claim, solutions: Sequence[JudgedSolution]) -> ArgumentGraph:
    """Return the graph of a claim.

    Args:
        name: name of the argument.
        claim: the top claim.
        solutions: its solutions, in the order of `Claim.list_solutions`.
    """
    judged = dict(_place_solutions(claim, iter(solutions)))
    builder = _GraphBuilder(judged, _place_sides(claim, judged))
    verdict = builder.add_claim(claim, ())
    return ArgumentGraph(
        name=name,
        verdict=verdict,
        elements=tuple(builder.elements),
        links=tuple(builder.links),
    )


def _place_solutions(
    claim: Claim, solutions: Iterator[JudgedSolution], path: ClaimPath = ()
) -> Iterator[tuple[ClaimPath, tuple[JudgedSolution, ...]]]:
    """Yield the solutions of each claim."""
    yield path, tuple(next(solutions) for _ in claim.solutions)
    for place, each in enumerate(claim.claims):
        yield from _place_solutions(each, solutions, (*path, place))


class _Side(NamedTuple):
    kind: ElementKind
    text: str


def _place_sides(
    claim: Claim, judged: Mapping[ClaimPath, tuple[JudgedSolution, ...]]
) -> dict[ClaimPath, list[_Side]]:
    """Return contexts and assumptions by the claim that they belong to."""
    users: dict[_Side, list[ClaimPath]] = {}
    for path, each in _list_claims(claim):
        for side in _list_sides(each, judged[path]):
            users.setdefault(side, []).append(path)
    placed: dict[ClaimPath, list[_Side]] = {}
    for kind in (ElementKind.CONTEXT, ElementKind.ASSUMPTION):
        for side, paths in users.items():
            if side.kind is kind:
                placed.setdefault(_find_common_path(paths), []).append(side)
    return placed


def _list_claims(claim: Claim, path: ClaimPath = ()) -> Iterator[tuple[ClaimPath, Claim]]:
    yield path, claim
    for place, each in enumerate(claim.claims):
        yield from _list_claims(each, (*path, place))


def _list_sides(claim: Claim, solutions: Iterable[JudgedSolution]) -> Iterator[_Side]:
    yield from (_Side(ElementKind.CONTEXT, each) for each in claim.context)
    yield from (_Side(ElementKind.ASSUMPTION, each) for each in claim.assumptions)
    for solution in solutions:
        found = solution.surroundings
        yield from (_Side(ElementKind.CONTEXT, each) for each in found.context)
        yield from (_Side(ElementKind.ASSUMPTION, each) for each in found.assumptions)


def _find_common_path(paths: Sequence[ClaimPath]) -> ClaimPath:
    """Return the deepest claim that contains all these claims; it may be one of them."""
    first, last = min(paths), max(paths)
    # Paths between the first and the last one in lexical order begin with what these share.
    shared = 0
    while shared < min(len(first), len(last)) and first[shared] == last[shared]:
        shared += 1
    return first[:shared]


def judge_claim(below: Sequence[ClaimVerdict]) -> ClaimVerdict:
    """Return the verdict of a claim from the verdicts of its parts, which are all needed.

    One refuted sub-claim or solution refutes the argument, and therefore the claim as argued.
    """
    if not below:
        return ClaimVerdict.UNDEVELOPED
    if ClaimVerdict.REFUTED in below:
        return ClaimVerdict.REFUTED
    all_hold = all(each is ClaimVerdict.SUPPORTED for each in below)
    return ClaimVerdict.SUPPORTED if all_hold else ClaimVerdict.UNDECIDED


@dataclass
class _GraphBuilder:
    """Numbers elements in reading order, and links them."""

    judged: Mapping[ClaimPath, tuple[JudgedSolution, ...]]
    sides: Mapping[ClaimPath, Sequence[_Side]]
    elements: list[ArgumentElement] = field(default_factory=list)
    links: list[ArgumentLink] = field(default_factory=list)
    counts: dict[ElementKind, int] = field(default_factory=dict)

    def add_claim(self, claim: Claim, path: ClaimPath) -> ClaimVerdict:
        """Add a claim with all below it, and return its verdict."""
        place, goal = len(self.elements), self._number(ElementKind.GOAL)
        # A placeholder keeps the order of the elements until the verdict is known.
        self.elements.append(ArgumentElement(id=goal, kind=ElementKind.GOAL, text=claim.text))
        for side in self.sides.get(path, ()):
            self._add(ArgumentElement(id=self._number(side.kind), kind=side.kind, text=side.text))
            self._link(goal, LinkKind.IN_CONTEXT_OF)
        above = self._add_strategy(claim, goal)
        below = [self._add_solution(each, above) for each in self.judged[path]]
        for number, each in enumerate(claim.claims):
            at = len(self.elements)
            below.append(self.add_claim(each, (*path, number)))
            link = ArgumentLink(
                source=above, target=self.elements[at].id, kind=LinkKind.SUPPORTED_BY
            )
            self.links.append(link)
        verdict = judge_claim(below)
        self.elements[place] = ArgumentElement(
            id=goal,
            kind=ElementKind.GOAL,
            text=claim.text,
            verdict=verdict,
            undeveloped=verdict in {ClaimVerdict.UNDECIDED, ClaimVerdict.UNDEVELOPED},
        )
        return verdict

    def _add_strategy(self, claim: Claim, goal: str) -> str:
        """Add the strategy of a claim, if any; return the id of the element that parts support."""
        if not claim.argument or not (claim.claims or claim.solutions):
            return goal
        kind = ElementKind.STRATEGY
        self._add(ArgumentElement(id=self._number(kind), kind=kind, text=claim.argument))
        self._link(goal, LinkKind.SUPPORTED_BY)
        return self.elements[-1].id

    def _add_solution(self, solution: JudgedSolution, above: str) -> ClaimVerdict:
        kind, found = ElementKind.SOLUTION, solution.finding
        element = ArgumentElement(
            id=self._number(kind),
            kind=kind,
            text=found.words,
            verdict=found.verdict,
            sha256=solution.sha256,
        )
        self._add(element)
        self._link(above, LinkKind.SUPPORTED_BY)
        return found.verdict

    def _add(self, element: ArgumentElement) -> None:
        self.elements.append(element)

    def _link(self, source: str, kind: LinkKind) -> None:
        """Link the newest element."""
        target = self.elements[-1].id
        self.links.append(ArgumentLink(source=source, target=target, kind=kind))

    def _number(self, kind: ElementKind) -> str:
        self.counts[kind] = self.counts.get(kind, 0) + 1
        return f"{PREFIXES[kind]}{self.counts[kind]}"
