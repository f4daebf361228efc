"""The requirement on a sensor, in sentences and rows."""

from collections.abc import Iterator, Mapping

from eigenfail.methods import describe_method
from eigenfail.presentation import figures
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail_assurance.risk.sentences import format_target
from eigenfail_assurance.sensor.scaling import describe_size
from eigenfail_assurance.sensor.search import Anchor, AnchorVerdict, ErrorLimit, RequirementAnswer

MORE = "More episodes may decide it (--budget)."

ANCHOR_COLUMNS = ("errors", "id", "episodes", "failures", "P(failure)", "bounds", "verdict")

FRONTIER_COLUMNS = ("at", "up to", "not met from")


def describe_answer(spec: CampaignSpec, answer: RequirementAnswer) -> list[str]:
    """Return the limits with the undecided ranges, and their basis."""
    limits = (*answer.limits, *answer.frontier)
    found = [each for limit in limits for each in describe_limit(spec, answer, limit)]
    return found + describe_basis(spec, answer)


def describe_basis(spec: CampaignSpec, answer: RequirementAnswer) -> list[str]:
    """Return why numbers are missing, contradictions, and what the confidence is of."""
    return [
        *_describe_unknown(answer),
        *_describe_contradictions(answer),
        _describe_confidence(answer),
        *_describe_method(spec),
    ]


def _describe_method(spec: CampaignSpec) -> Iterator[str]:
    if not describe_method(spec.method).traits.draws_from_prior:
        yield (
            f"The confidence is that of the intervals of '{spec.method}', which is approximate. "
            "Failures that no sample came near are not in it, and errored or unresolved episodes "
            "count as none."
        )


def describe_limit(
    spec: CampaignSpec, answer: RequirementAnswer, limit: ErrorLimit
) -> Iterator[str]:
    """Yield the sentence for the supplier, and the results beyond the limit."""
    target = format_target(answer.question.target)
    size, beside = describe_size(spec.disturbance, limit.channel), _format_beside(limit.beside)
    if limit.largest is None:
        what = size.replace("up to {}", f"of {limit.tests[0]:g}")
        yield f"P(failure) was not shown to be at most {target} for {what}{beside}."
    else:
        what = size.format(f"{limit.largest:g}")
        yield (
            f"With {format_confidence(answer.question.confidence)} confidence, P(failure) in "
            f"{spec.scenario} with {spec.planner} is at most {target} for {what}{beside}."
        )
    yield from _describe_beyond(limit, target)


def _describe_beyond(limit: ErrorLimit, target: str) -> Iterator[str]:
    if limit.at_high_end:
        yield f"{limit.largest:g} × is the high end of the search: more may be allowed (--high)."
    elif limit.undecided:
        above = limit.undecided[-1] if limit.not_met_from is None else limit.not_met_from
        below = limit.tests[0] if limit.largest is None else limit.largest
        only = f"at {below:g} ×, the low end of the search"
        between = f"between {below:g} × and {above:g} ×" if above > below else only
        yield f"It is undecided {between}. {MORE}"
    if limit.not_met_from is not None:
        lower = " Search lower (--low)." if limit.not_met_from == limit.tests[0] else ""
        yield (
            f"From {limit.not_met_from:g} × on, P(failure) is above {target}, by the bounds at "
            f"this error alone.{lower}"
        )


def _format_beside(beside: Mapping[str, float]) -> str:
    return "".join(f", with {name} at {multiple:g} ×" for name, multiple in beside.items())


def format_confidence(confidence: float) -> str:
    """Return a confidence as it was given, in percent."""
    return f"{100.0 * confidence:.12g} %"


def _describe_unknown(answer: RequirementAnswer) -> Iterator[str]:
    for problem in dict.fromkeys(one.problem for one in answer.anchors if one.problem):
        having = [one for one in answer.anchors if one.problem == problem]
        where = "; ".join(format_multiples(one.multiples) for one in having)
        yield f"No number at {where}: {problem}"


def _describe_contradictions(answer: RequirementAnswer) -> Iterator[str]:
    for pair in answer.contradictions:
        smaller, larger = (format_multiples(each.multiples) for each in (pair.smaller, pair.larger))
        yield (
            f"Not monotone: P(failure) is larger at {smaller} than at {larger}, by their bounds. "
            "The smaller errors count."
        )


def _describe_confidence(answer: RequirementAnswer) -> str:
    question = answer.question
    checked = "" if answer.contradictions else ", which no bounds contradict"
    of_points = ", and so do all on the frontier together" if answer.frontier else ""
    confidence = format_confidence(question.confidence)
    return (
        f"It is assumed that P(failure) does not fall as errors grow{checked}. Each limit of "
        f"one channel holds with {confidence} confidence{of_points}: the error is divided by the "
        f"number of tests of a search, up to {question.tests}. That of the errors that do not meet "
        "the target is not part of this: more tests may look for the smallest of them."
    )


def format_multiples(multiples: Mapping[str, float]) -> str:
    """Return multiples by channel, such as "longitudinal × 1.3, missed × 2"."""
    return ", ".join(f"{name} × {multiple:g}" for name, multiple in multiples.items())


def list_anchor_row(anchor: Anchor) -> tuple[str, ...]:
    """Return the cells of `ANCHOR_COLUMNS`."""
    has_bounds = anchor.verdict is not AnchorVerdict.UNKNOWN
    return (
        format_multiples(anchor.multiples),
        str(anchor.campaign),
        figures.format_count(anchor.episodes),
        figures.format_count(anchor.failures),
        figures.format_number(anchor.probability),
        figures.format_interval(anchor.bounds) if has_bounds else figures.UNKNOWN,
        anchor.verdict.value,
    )


def list_frontier_row(limit: ErrorLimit) -> tuple[str, ...]:
    """Return the cells of `FRONTIER_COLUMNS`."""
    ends = (limit.largest, limit.not_met_from)
    met, not_met = (
        figures.UNKNOWN if end is None else format_multiples({limit.channel: end}) for end in ends
    )
    return format_multiples(limit.beside), met, not_met
