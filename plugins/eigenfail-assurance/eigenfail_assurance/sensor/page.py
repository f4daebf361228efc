"""The answer as one HTML page without links to elsewhere: sentences, pictures as SVG, tables."""

from collections.abc import Iterable, Iterator, Sequence
from html import escape
from math import floor, log, log10
from typing import NamedTuple

from eigenfail import __version__
from eigenfail.presentation import figures
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.worlds import world_of
from eigenfail_assurance.risk.sentences import format_target
from eigenfail_assurance.sensor import sentences
from eigenfail_assurance.sensor.scaling import describe_size
from eigenfail_assurance.sensor.search import Anchor, AnchorVerdict, ErrorLimit, RequirementAnswer

INK, MUTED, GRID, SAFE, UNSAFE = "#16202a", "#525e6b", "#d6dbe1", "#0072b2", "#b34700"

WIDTH, HEIGHT = 640, 380
LEFT, RIGHT, TOP, BOTTOM = 76, 616, 16, 326
"""Of a picture, and of the area inside its axes. [px]"""

ROOM = 1.12
"""Ratio by which an axis of multiples reaches beyond what it shows."""

ROUND_MULTIPLES = (0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.4, 2.0, 3.0, 5.0, 7.0, 10.0)

SMALLEST_SHOWN = 1e-12
"""Lower ends of bounds that are 0 or nearly so are drawn to the lower edge."""

MOST_DECADES = 8

STYLE = """
html { font: 16px/1.5 system-ui, "Segoe UI", "Noto Sans", Arial, sans-serif; color: #16202a; }
body { margin: 0 auto; max-width: 52rem; padding: 2rem 1.25rem 3rem; }
h1 { font-size: 1.7rem; line-height: 1.2; } h2 { font-size: 1.2rem; margin-top: 2rem; }
.answer { background: #f1f3f6; border-left: 4px solid #0b4f8a; padding: 0.8rem 1rem; }
.answer p { margin: 0.3rem 0; } .made, figcaption { color: #525e6b; font-size: 0.9rem; }
figure { margin: 1rem 0; } svg { display: block; width: 100%; height: auto; max-width: 40rem; }
table { border-collapse: collapse; font-size: 0.88rem; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: 0.3rem 0.8rem 0.3rem 0; border-bottom: 1px solid #d6dbe1; }
.scroll { overflow-x: auto; }
@page { margin: 16mm; }
@media print { body { max-width: none; padding: 0; } figure, tr { break-inside: avoid; } }
"""


def format_page(spec: CampaignSpec, answer: RequirementAnswer) -> str:
    """Return the page of an answer.

    Args:
        spec: the campaign that was asked about.
        answer: requirement on the sensor, as found by the search.
    """
    title = f"Sensor requirement: {spec.name}"
    return "\n".join(
        (
            '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{escape(title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<main>",
            f"<h1>{escape(title)}</h1>",
            *_format_answer(spec, answer),
            *_format_frontier(spec, answer),
            *(part for limit in answer.limits for part in _format_channel(spec, answer, limit)),
            *_format_basis(spec, answer),
            f'<p class="made">Made by eigenfail {escape(__version__)}.</p>',
            "</main>\n</body>\n</html>\n",
        )
    )


def _format_answer(spec: CampaignSpec, answer: RequirementAnswer) -> Iterator[str]:
    yield '<section class="answer">'
    for limit in answer.limits:
        for sentence in sentences.describe_limit(spec, answer, limit):
            yield f"<p>{escape(sentence)}</p>"
    yield "</section>"
    road = " d is the true distance between the centres of the ego and the vehicle [m]."
    yield f"<p>All other errors are as in the campaign.{road * _has_road(spec)}</p>"


def _format_frontier(spec: CampaignSpec, answer: RequirementAnswer) -> Iterator[str]:
    if not answer.frontier:
        return
    kept, searched = answer.question.channels
    caption = (
        f"Multiples of {kept} and {searched} at which P(failure) was bounded. The shaded area "
        "meets the target, if P(failure) does not fall as errors grow."
    )
    yield f"<h2>{escape(kept)} and {escape(searched)} jointly</h2>"
    yield _format_figure(draw_frontier(spec, answer), caption)
    yield _format_table(
        sentences.FRONTIER_COLUMNS, map(sentences.list_frontier_row, answer.frontier)
    )


def _format_channel(
    spec: CampaignSpec, answer: RequirementAnswer, limit: ErrorLimit
) -> Iterator[str]:
    yield f"<h2>{escape(limit.channel)}</h2>"
    caption = (
        f"P(failure) by the error of {limit.channel}: estimates with their bounds; dashed: the "
        f"target, {format_target(answer.question.target)}; dotted: the campaign's own sensor."
    )
    yield _format_figure(draw_probabilities(spec, answer, limit), caption)


def _format_basis(spec: CampaignSpec, answer: RequirementAnswer) -> Iterator[str]:
    yield "<h2>What it rests on</h2>"
    noise = spec.disturbance.in_words() if _has_road(spec) else {}
    facts = {
        "planner": spec.planner,
        "scenario": spec.scenario,
        "simulator": spec.simulator,
        "method": f"{spec.method}, up to {figures.format_count(spec.episodes)} episodes for each "
        "error",
        "seed": str(spec.seed),
        "target": format_target(answer.question.target),
        "confidence": sentences.format_confidence(answer.question.confidence),
        **{f"noise: {name}": words for name, words in noise.items()},
        **{f"parameter {name}": str(value) for name, value in spec.scenario_parameters.items()},
    }
    yield _format_table(("setting", "value"), facts.items())
    for sentence in sentences.describe_basis(spec, answer):
        yield f"<p>{escape(sentence)}</p>"
    yield _format_table(sentences.ANCHOR_COLUMNS, map(sentences.list_anchor_row, answer.anchors))


def _has_road(spec: CampaignSpec) -> bool:
    return world_of(spec.simulator).has_road


def _format_figure(picture: str, caption: str) -> str:
    return f"<figure>{picture}<figcaption>{escape(caption)}</figcaption></figure>"


def _format_table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    head = "".join(f'<th scope="col">{escape(each)}</th>' for each in columns)
    body = "".join(
        f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows
    )
    return (
        f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>'
        "</div>"
    )


class LogAxis(NamedTuple):
    """A logarithmic axis of a picture.

    Attributes:
        low: value at its beginning.
        high: value at its end.
        begin: place of its beginning [px].
        end: place of its end [px].
        ticks: values with a label, inside.
    """

    low: float
    high: float
    begin: float
    end: float
    ticks: tuple[float, ...]

    def place(self, value: float) -> float:
        """Return the place of a value; values beyond an end are placed at the end. [px]"""
        inside = min(max(value, self.low), self.high)
        share = log(inside / self.low) / log(self.high / self.low)
        return round(self.begin + share * (self.end - self.begin), 1)


def _make_multiple_axis(multiples: Iterable[float], begin: float, end: float) -> LogAxis:
    shown = (1.0, *multiples)
    low, high = min(shown) / ROOM, max(shown) * ROOM
    ticks = tuple(each for each in ROUND_MULTIPLES if low <= each <= high)
    return LogAxis(low, high, begin, end, ticks)


def _make_probability_axis(values: Iterable[float]) -> LogAxis:
    """Return an axis of whole decades that holds the values, upwards."""
    shown = [max(value, SMALLEST_SHOWN) for value in values if value > 0.0]
    high = min(floor(log10(max(shown))) + 1, 0)
    low = min(max(floor(log10(min(shown))), high - MOST_DECADES), high - 1)
    ticks = tuple(10.0**power for power in range(low, high + 1))
    return LogAxis(10.0**low, 10.0**high, BOTTOM, TOP, ticks)


def draw_probabilities(spec: CampaignSpec, answer: RequirementAnswer, limit: ErrorLimit) -> str:
    """Return a picture of P(failure) by the multiple of one channel's error, as SVG."""
    name, target = limit.channel, answer.question.target
    anchors = [each for each in answer.anchors if each.multiples.keys() == {name}]
    values = (
        value
        for each in anchors
        for value in (each.probability or 0.0, each.bounds.low, each.bounds.high)
    )
    x = _make_multiple_axis((each.multiples[name] for each in anchors), LEFT, RIGHT)
    y = _make_probability_axis((target, *values))
    at, own = y.place(target), x.place(1.0)
    parts = [
        *_draw_axes(x, y, _label(spec, name), "P(failure)"),
        f'<path d="M{LEFT} {at}H{RIGHT}" stroke="{INK}" stroke-dasharray="6 4"/>',
        f'<path d="M{own} {TOP}V{BOTTOM}" stroke="{MUTED}" stroke-dasharray="2 4"/>',
    ]
    for each in anchors:
        across, colour = x.place(each.multiples[name]), _choose_colour(each)
        ends = f"M{across} {y.place(each.bounds.low)}V{y.place(each.bounds.high)}"
        if each.verdict is not AnchorVerdict.UNKNOWN:
            parts.append(f'<path d="{ends}" stroke="{colour}" stroke-width="1.6"/>')
        if each.probability:
            parts.append(_draw_mark(each, across, y.place(each.probability)))
    return _wrap_picture(parts, f"P(failure) by the error of {name}")


def draw_frontier(spec: CampaignSpec, answer: RequirementAnswer) -> str:
    """Return the picture of the frontier of two channels, as SVG."""
    kept, searched = answer.question.channels
    places = [
        (each, each.multiples.get(kept, 1.0), each.multiples.get(searched, 1.0))
        for each in answer.anchors
    ]
    x = _make_multiple_axis((across for _, across, _ in places), LEFT, RIGHT)
    y = _make_multiple_axis((up for _, _, up in places), BOTTOM, TOP)
    corners = [
        (limit.beside[kept], limit.largest)
        for limit in answer.frontier
        if limit.largest is not None
    ]
    safe = "".join(
        f"M{LEFT} {BOTTOM}V{y.place(up)}H{x.place(across)}V{BOTTOM}Z" for across, up in corners
    )
    own = f"M{x.place(1.0)} {y.place(1.0)}"
    parts = [
        *_draw_axes(x, y, _label(spec, kept), _label(spec, searched)),
        f'<path d="{safe}" fill="#dcebf5"/>' if safe else "",
        *(_draw_mark(each, x.place(across), y.place(up)) for each, across, up in places),
        f'<path d="{own}m-8 0h16m-8 -8v16" stroke="{INK}" stroke-width="2"/>',
        f'<text x="{x.place(1.0) + 10}" y="{y.place(1.0) - 8}">the campaign\'s sensor</text>',
    ]
    return _wrap_picture(parts, f"Errors of {kept} and {searched} that meet the target")


MARKS = {
    AnchorVerdict.MET: ("●", "meets the target"),
    AnchorVerdict.NOT_MET: ("×", "does not"),
    AnchorVerdict.UNDECIDED: ("○", "undecided"),
    AnchorVerdict.UNKNOWN: ("?", "no number"),
}
"""Mark and meaning of each verdict; shapes differ, so that colour is not needed."""


def _choose_colour(anchor: Anchor) -> str:
    colours = {AnchorVerdict.MET: SAFE, AnchorVerdict.NOT_MET: UNSAFE}
    return colours.get(anchor.verdict, MUTED)


def _draw_mark(anchor: Anchor, across: float, up: float) -> str:
    sign, _ = MARKS[anchor.verdict]
    return (
        f'<text x="{across}" y="{up + 5}" text-anchor="middle" font-size="15" '
        f'fill="{_choose_colour(anchor)}">{sign}</text>'
    )


def _draw_axes(x: LogAxis, y: LogAxis, below: str, beside: str) -> Iterator[str]:
    for tick in x.ticks:
        at = x.place(tick)
        yield f'<path d="M{at} {TOP}V{BOTTOM}" stroke="{GRID}"/>'
        yield f'<text x="{at}" y="{BOTTOM + 18}" text-anchor="middle">{tick:g}</text>'
    for tick in y.ticks:
        at = y.place(tick)
        yield f'<path d="M{LEFT} {at}H{RIGHT}" stroke="{GRID}"/>'
        text = f"{tick:g}" if tick >= figures.SMALLEST_PLAIN else figures.format_number(tick, 1)
        yield f'<text x="{LEFT - 8}" y="{at + 4}" text-anchor="end">{text}</text>'
    middle = (TOP + BOTTOM) / 2
    yield f'<path d="M{LEFT} {TOP}V{BOTTOM}H{RIGHT}" fill="none" stroke="{MUTED}"/>'
    yield f'<text x="{(LEFT + RIGHT) / 2}" y="{HEIGHT - 18}" text-anchor="middle">{below}</text>'
    yield (
        f'<text transform="translate(16 {middle}) rotate(-90)" text-anchor="middle">{beside}</text>'
    )


def _label(spec: CampaignSpec, name: str) -> str:
    """Return the label of an axis: which multiples it has."""
    return escape(describe_size(spec.disturbance, name).replace("up to {} ×", "as multiples of"))


def _wrap_picture(parts: Iterable[str], title: str) -> str:
    legend = "\u2003".join(f"{sign} {words}" for sign, words in MARKS.values())
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" '
        f'font-family="system-ui, sans-serif" font-size="13" fill="{INK}">'
        f"<title>{escape(title)}</title>{''.join(parts)}"
        f'<text x="{LEFT}" y="{HEIGHT - 2}" font-size="12" fill="{MUTED}">{legend}</text></svg>'
    )
