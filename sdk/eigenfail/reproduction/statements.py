"""What the paper says of its tables, held against ours; each from one seed, so none is final."""

from collections.abc import Callable, Iterator, Mapping

from eigenfail.reproduction.differences import above_half, likelier, more_severe
from eigenfail.reproduction.results import Statement
from eigenfail.values import Comparison, Safety, Summary

Summaries = Mapping[str, Summary]
Safeties = Mapping[str, Safety]
Compare = Callable[[str, str], Comparison]
"""From the names of two members to B minus A."""

Part = bool | None
"""Whether it is so; None where the interval of a difference holds 0."""

NEEDED = (
    *("sweep base", "sweep alpha=500", "sweep c_dist=100", "sweep c_dist=5000"),
    *("sweep batch_size=16", "sweep batch_size=256", "sweep tau=0.001", "sweep tau=0.01"),
    *("sweep buffer_size=10000", "sweep buffer_size=1000000"),
    *("ast evaluation", "ast_paper evaluation", "difs evaluation", "difs_paper evaluation"),
)
"""Members whose failures are held against each other one by one."""


def of_campaigns(found: Summaries, safeties: Safeties, compare: Compare) -> Iterator[Statement]:
    """The statements that summaries, failures and comparisons decide."""
    yield planners(found)
    yield rare(found)
    yield batches(found, safeties, compare)
    yield small_alpha(found, safeties, compare)
    yield large_c_dist(found, safeties, compare)
    yield slow_target(found, safeties)
    for kind in ("", "_paper"):
        yield likelier_difs(kind, found, safeties)
    yield moved(found)


def planners(found: Summaries) -> Statement:
    """IDM fails, the planner does not."""
    ours, idm = (found[f"monte_carlo {name}"] for name in ("rulebook", "idm"))
    holds = None
    if ours.failure_rate and idm.failure_rate:
        holds = ours.failure_rate.interval.high < idm.failure_rate.interval.low
    return Statement(
        "Under Monte Carlo the planner fails less often than IDM.",
        holds,
        f"{told(ours)} against {told(idm)}",
    )


def rare(found: Summaries) -> Statement:
    """Monte Carlo finds nothing where the searches do."""
    monte_carlo = found["monte_carlo rulebook"]
    searches = {name: found[f"{name} evaluation"] for name in ("ast_paper", "difs_paper", "difs")}
    holds = not monte_carlo.counts.failures and all(s.counts.failures for s in searches.values())
    figures = "; ".join(f"{name}: {told(summary)}" for name, summary in searches.items())
    return Statement(
        "Monte Carlo finds no failure where AST and DiFS both do.",
        holds,
        f"Monte Carlo: {told(monte_carlo)}; {figures}",
    )


def batches(found: Summaries, safeties: Safeties, compare: Compare) -> Statement:
    """Batch size 16 against 256."""
    a, b = names = ("sweep batch_size=256", "sweep batch_size=16")
    parts = (
        more_often(compare(a, b)),
        likelier(safeties[a], safeties[b]),
        more_severe(safeties[a], safeties[b]),
    )
    return judged("A small batch improves failure rate, log p and severity.", found, names, parts)


def small_alpha(found: Summaries, safeties: Safeties, compare: Compare) -> Statement:
    """Alpha 500 against 10,000."""
    a, b = names = ("sweep base", "sweep alpha=500")
    parts = (more_often(compare(b, a)), likelier(safeties[a], safeties[b]))
    return judged("A small alpha makes failures likelier and fewer.", found, names, parts)


def large_c_dist(found: Summaries, safeties: Safeties, compare: Compare) -> Statement:
    """Penalty 5000 against 100."""
    a, b = names = ("sweep c_dist=100", "sweep c_dist=5000")
    parts = (more_often(compare(a, b)), more_severe(safeties[a], safeties[b]))
    says = "A large c_dist makes failures more frequent and more severe."
    return judged(says, found, names, parts)


def slow_target(found: Summaries, safeties: Safeties) -> Statement:
    """Tau 0.001 against 0.01, and a buffer of a million against ten thousand."""
    pairs = (
        ("sweep tau=0.01", "sweep tau=0.001"),
        ("sweep buffer_size=10000", "sweep buffer_size=1000000"),
    )
    parts = tuple(likelier(safeties[a], safeties[b]) for a, b in pairs)
    says = "A small tau and a large buffer make failures likelier."
    return judged(says, found, (*pairs[0], *pairs[1]), parts)


def likelier_difs(kind: str, found: Summaries, safeties: Safeties) -> Statement:
    """DiFS against AST, both by default or both with the paper's settings."""
    a, b = names = (f"ast{kind} evaluation", f"difs{kind} evaluation")
    parts = (likelier(safeties[a], safeties[b]),)
    return judged("DiFS finds likelier failures than AST.", found, names, parts)


def moved(found: Summaries) -> Statement:
    """The policy of AST at other distances."""
    names = tuple(f"ast {place}" for place in ("evaluation", "plus5", "minus5"))
    parts = tuple(above_half(found[name].failure_rate) for name in names)
    says = "AST's policy fails the planner at other distances of the cut-in, too."
    return judged(says, found, names, parts)


def judged(
    paper: str, found: Summaries, names: tuple[str, ...], parts: tuple[Part, ...]
) -> Statement:
    """A statement of several parts: false if one is, open if one is open and none is false."""
    open_or_true = None if None in parts else True
    holds = False if False in parts else open_or_true
    figures = "; ".join(f"{name}: {told(found[name])}" for name in names)
    return Statement(paper, holds, figures)


def more_often(comparison: Comparison) -> Part:
    """Whether B fails more often, by Newcombe's interval."""
    difference = comparison.difference
    if difference is None or difference.interval.low <= 0.0 <= difference.interval.high:
        return None
    return difference.value > 0.0


def told(summary: Summary) -> str:
    """Failures of episodes, log p per step and severity."""
    counts = summary.counts
    words = [f"{counts.failures} of {counts.completed}"]
    if summary.log_probability_per_step is not None:
        words.append(f"log p {summary.log_probability_per_step:.2f} per step")
    if summary.mean_severity is not None:
        words.append(f"severity {summary.mean_severity:.0f} m²/s²")
    return ", ".join(words)
