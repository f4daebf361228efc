"""The report of a bundle as one HTML page without links to elsewhere, and as text for terminals."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from html import escape

from eigenfail.presentation.figures import UNKNOWN
from eigenfail.presentation.tables import PLAIN, format_cell
from eigenfail_assurance.evidence import argument
from eigenfail_assurance.evidence.judgement import ClaimVerdict
from eigenfail_assurance.evidence.solutions import SolutionCampaign, SolutionRecord
from eigenfail_assurance.sensor.page import STYLE

MARKS = {
    ClaimVerdict.SUPPORTED: "✓",
    ClaimVerdict.REFUTED: "✗",
    ClaimVerdict.UNDECIDED: "?",
    ClaimVerdict.UNDEVELOPED: "◇",
}

PICTURE_STYLE = """
body { max-width: 100rem; } p, h1, h2, h3, table { max-width: 60rem; }
figure svg { max-width: none; min-width: 40rem; }
"""

WHAT_HASHES_SHOW = (
    "Hashes show that the files of this bundle belong together. Whoever can change all of them can "
    "compute the hashes again: compare the root hash with one that came another way."
)

SCROLLED = '<div class="scroll" role="region" tabindex="0" aria-label="'
"""Opens a part that scrolls by itself, also with the keyboard; its name follows."""

CAMPAIGN_COLUMNS = ("Campaign", "Planner", "Digest of all episodes", "Services", "Workers")


def format_evidence_page(
    graph: argument.ArgumentGraph, solutions: Sequence[SolutionRecord], picture: str, product: str
) -> str:
    """Return the page of an argument.

    Args:
        graph: the argument.
        solutions: its solutions.
        picture: the graph as SVG.
        product: version of the product.
    """
    title = f"Evidence: {graph.name}"
    return "\n".join(
        (
            '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{escape(title)}</title>\n<style>{STYLE}{PICTURE_STYLE}</style>",
            "</head>\n<body>\n<main>",
            f"<h1>{escape(title)}</h1>",
            f'<section class="answer"><p>{escape(describe_verdict(graph))}</p></section>',
            "<h2>Argument</h2>",
            f'<figure>{SCROLLED}Argument">{picture}</div>',
            f"<figcaption>{escape(CAPTION)}</figcaption></figure>",
            "<h2>Claims</h2>",
            _format_claims(graph),
            *_format_sides(graph),
            "<h2>Solutions</h2>",
            *(part for each in solutions for part in _format_solution(each, graph)),
            f'<p class="made">{escape(WHAT_HASHES_SHOW)} Made by eigenfail {escape(product)}.</p>',
            "</main>\n</body>\n</html>\n",
        )
    )


CAPTION = (
    "Goal Structuring Notation: rectangles are claims, parallelograms strategies, circles "
    "solutions, round rectangles contexts, ellipses with an A assumptions. A diamond marks a claim "
    "that nothing supports so far; a cross and a double border one that is refuted. The file "
    "argument.svg beside this page is the same picture, to enlarge."
)


def describe_verdict(graph: argument.ArgumentGraph) -> str:
    """Return the verdict of the top claim, with the claims that are not supported."""
    goals = [each for each in graph.elements if each.kind is argument.ElementKind.GOAL]
    top = goals[0]
    parts = [f"{graph.name}: {graph.verdict}. {top.text}"]
    parts += [
        f"{verdict.capitalize()}: {', '.join(names)}."
        for verdict in (ClaimVerdict.REFUTED, ClaimVerdict.UNDECIDED, ClaimVerdict.UNDEVELOPED)
        if (names := [each.id for each in goals[1:] if each.verdict is verdict])
    ]
    return " ".join(parts)


def list_lines(graph: argument.ArgumentGraph) -> Iterator[str]:
    """Yield claims and solutions as an indented list, each with its verdict."""
    elements = {each.id: each for each in graph.elements}
    below: dict[str, list[str]] = {}
    for link in graph.links:
        if link.kind is argument.LinkKind.SUPPORTED_BY:
            below.setdefault(link.source, []).append(link.target)
    yield from _indent(graph.elements[0].id, elements, below, 0)


def _indent(
    name: str,
    elements: Mapping[str, argument.ArgumentElement],
    below: Mapping[str, Sequence[str]],
    depth: int,
) -> Iterator[str]:
    element = elements[name]
    if element.kind is argument.ElementKind.STRATEGY:
        yield f"{'  ' * depth}  {name}: {element.text}"
    else:
        verdict = element.verdict or ClaimVerdict.UNDEVELOPED
        yield f"{'  ' * depth}{MARKS[verdict]} {name} {verdict}: {element.text}"
    for each in below.get(name, ()):
        yield from _indent(each, elements, below, depth + 1)


def _format_claims(graph: argument.ArgumentGraph) -> str:
    rows = [
        (each.id, f"{MARKS[each.verdict]} {each.verdict}", each.text)
        for each in graph.elements
        if each.kind is argument.ElementKind.GOAL and each.verdict is not None
    ]
    return _format_table(("Claim", "Verdict", "Text"), rows)


def _format_sides(graph: argument.ArgumentGraph) -> Iterator[str]:
    """Yield the contexts and assumptions, with the claims that they belong to."""
    sources = {each.target: each.source for each in graph.links}
    headings = {
        argument.ElementKind.CONTEXT: "Context",
        argument.ElementKind.ASSUMPTION: "Assumptions",
    }
    for kind, heading in headings.items():
        found = [each for each in graph.elements if each.kind is kind]
        if found:
            yield f"<h2>{heading}</h2>"
            rows = [(each.id, sources[each.id], each.text) for each in found]
            yield _format_table((heading, "Claim", "Text"), rows)


def _format_solution(solution: SolutionRecord, graph: argument.ArgumentGraph) -> Iterator[str]:
    element = next(each for each in graph.elements if each.id == solution.id)
    found = solution.finding
    yield f'<h3 id="solution-{solution.id}">{solution.id}: {escape(solution.kind)}</h3>'
    yield f"<p>{MARKS[found.verdict]} {found.verdict}. {escape(found.words)}</p>"
    figures = [
        (name, format_cell(value, PLAIN).line) for name, value in sorted(found.figures.items())
    ]
    facts = [*figures, (f"SHA-256 of solutions/{solution.id}.json", element.sha256)]
    yield _format_table(("Figure", "Value"), facts)
    if solution.campaigns:
        yield _format_table(CAMPAIGN_COLUMNS, map(_list_campaign, solution.campaigns))


def _list_campaign(each: SolutionCampaign) -> tuple[str, ...]:
    planner, version = each.planner.name, each.planner.version
    workers = [_format_versions(one.versions) for one in each.workers]
    services = [_format_versions(one) for one in each.services]
    return (
        str(each.campaign),
        f"{planner} {version}" if version else f"{planner} (no version recorded)",
        each.digest or UNKNOWN,
        "; then ".join(services) or UNKNOWN,
        "; ".join(workers) or UNKNOWN,
    )


def _format_versions(versions: Mapping[str, str]) -> str:
    return ", ".join(f"{name} {value}" for name, value in sorted(versions.items())) or UNKNOWN


def _format_table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    head = "".join(f'<th scope="col">{escape(each)}</th>' for each in columns)
    body = "".join(
        f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows
    )
    return (
        f'{SCROLLED}{escape(columns[0] or columns[1])}"><table>'
        f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )
