"""Tables of episodes: a list, one with its measures, and the steps of an explained one."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any

from eigenfail.filters import Value, find_column
from eigenfail.presentation import figures, tables
from eigenfail.values.analysis import MinimalFailure
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.disturbance import ChannelLikelihood
from eigenfail.values.measures import MEASURES, Measures
from eigenfail.values.proof import ExplainedStep, Explanation
from eigenfail.values.records import LEAD_TIMES, Assessment, EpisodeDetail, EpisodeRow
from eigenfail.worlds import world_of

LIKELIER = (
    "log p rises as noise is left out, since p(x) is densest at zero; it does not say how rare "
    "such failures are."
)
LOG_P_DIGITS = 5
"""Significant digits of log p over an episode, whose differences count, not its size."""


EPISODE = tables.read_number("Episode", lambda row: f"{row.campaign}/{row.index}")
CLASS = tables.read_text("Class", lambda row: format_class(row.assessed))
LOG_P = tables.Reading(tables.TableColumn("log p", "nats", digits=LOG_P_DIGITS), "log_probability")
SEVERITY = tables.read_number("Severity", "severity", "m²/s²")
STEPS = tables.read_number("Steps", "steps")
HOW_IT_ENDED = (EPISODE, tables.read_text("Outcome", "outcome.word"), CLASS, STEPS)
MEASURED = (
    LOG_P,
    SEVERITY,
    tables.read_number("Min TTC", "min_ttc_s", "s"),
    tables.read_number("Max DRAC", "max_drac_mps2", "m/s²"),
    tables.read_number("TTC lead", "assessed.ttc_lead_s", "s"),
    tables.read_number("DRAC lead", "assessed.drac_lead_s", "s"),
    tables.read_text("Source", "source"),
    tables.read_text("Worker", "worker"),
)


def tabulate_episodes(rows: Iterable[EpisodeRow], unit: str = "") -> tables.Table:
    """Return a list of episodes; `unit` is their unit of robustness, empty if it is not known."""
    robustness = tables.read_number("Robustness", "robustness_m", unit)
    return tables.tabulate("Episodes", rows, *HOW_IT_ENDED, robustness, *MEASURED)


def tabulate_failures(rows: Iterable[EpisodeRow]) -> tables.Table:
    """Return a list of failures of several campaigns."""
    return tables.tabulate("Failures", rows, EPISODE, SEVERITY, CLASS, LOG_P, STEPS)


def tabulate_fields(
    names: Sequence[str], rows: Iterable[Mapping[str, Value | None]]
) -> tables.Table:
    """Return some columns of episodes, with the column names that filters use."""
    # Named as in filters: what is listed can be typed into the next filter.
    described = (find_column(name, "fields") for name in names)
    columns = tuple(tables.TableColumn(each.name, is_figure=each.is_ordered) for each in described)
    values = ([row[name] for name in names] for row in rows)
    cells = tuple(
        # A seed or a number of an episode is a name, whose digits stand together.
        tuple(each if each is None or isinstance(each, float) else str(each) for each in row)
        for row in values
    )
    return tables.Table("Episodes", columns, cells)


def format_class(assessed: Assessment) -> str:
    """Return the conflict class of an outcome as text."""
    return assessed.beside((assessed.conflict or figures.UNKNOWN).replace("_", " "))


def list_episode_facts(
    name: str,
    result: EpisodeDetail,
    spec: CampaignSpec | None = None,
    drawn: Mapping[str, Any] = MappingProxyType({}),
) -> tables.FactTable:
    """Return one episode with the scenario parameters that it drew, and its measures.

    Args:
        name: name of the episode in the table.
        result: the episode.
        spec: specification of its campaign, if known; it names the requirements.
        drawn: scenario parameters that the episode drew.
    """
    # Of a function robustness alone was measured, which has no unit.
    has_road = spec is None or world_of(spec.simulator).has_road
    judged = list_judged(spec, result.requirements) if spec else ()
    likelihood = figures.format_number(result.noise.log_probability, LOG_P_DIGITS)
    fault, measures, measured = result.fault, result.measures, list[tuple[str, str]]()
    if measures and has_road:
        measured += list_measures(measures, result.assessed)
    elif measures:
        measured.append(("robustness", figures.format_number(measures.robustness_m)))
    rows = (
        ("episode", f"{name}, seed {result.seed}"),
        ("outcome", result.outcome.word),
        *([("class", result.assessed.words or figures.UNKNOWN)] if has_road else []),
        ("steps", str(result.steps)),
        *(("scenario", f"{parameter} = {value}") for parameter, value in drawn.items()),
        ("disturbances", f"from {result.source}, log p {likelihood}"),
        *list_channel_likelihoods(result.likelihoods),
        *((f"requirement {label}", words) for label, words in judged),
        *measured,
        ("scene", "stored" if result.scene else "not stored"),
        ("digest", result.digest()),
        *([("problem", f"{fault.kind}: {fault.message}")] if fault else []),
    )
    return tables.FactTable("Episode", rows)


def list_channel_likelihoods(
    likelihoods: Sequence[ChannelLikelihood],
) -> Iterator[tuple[str, str]]:
    """Yield log p of the noise of each channel, absolute and relative to log p of z = 0."""
    for each in likelihoods:
        of_channel = figures.format_number(each.log_probability, LOG_P_DIGITS)
        relative = figures.format_number(each.relative, LOG_P_DIGITS)
        yield f"log p of {each.name}", f"{of_channel}, {relative} relative to z = 0"


OF_REQUIREMENTS = frozenset({"nearest_m", "violated"})
"""Measures of campaigns that name requirements."""


def list_measures(measures: Measures, assessed: Assessment) -> Iterator[tuple[str, str]]:
    """Yield the measures of an episode by label and unit, then its lead times."""
    # Without requirements both would be a dash in every episode.
    absent = OF_REQUIREMENTS if measures.nearest_m is None else frozenset[str]()
    for declared, values in ((MEASURES, measures), (LEAD_TIMES, assessed)):
        for name, measure in declared.items():
            if name in absent:
                continue
            value = getattr(values, name)
            if measure.is_count:
                value = figures.format_count(value)
            elif not measure.is_text:
                value = figures.format_number(value, measure.digits)
            # A missing number is a dash by now; a missing text, such as a cause, tells nothing.
            if value is not None:
                # The robustness of requirements is divided by their scales, and has no unit.
                has_unit = absent or name != "robustness_m"
                yield measure.heading if has_unit else measure.label, value


def list_judged(spec: CampaignSpec, values: Sequence[float | None]) -> Iterator[tuple[str, str]]:
    """Yield each named requirement, with the robustness of an episode.

    Args:
        spec: the campaign.
        values: robustness of each requirement; empty for an errored episode.
    """
    # Not strict: an episode that errored was judged by no requirement.
    for each, value in zip(spec.named_requirements, values, strict=False):
        if value is None:
            yield each.label, f"not judged: the episode ended before. Demands: {each.in_words()}"
            continue
        state = "violated" if value <= 0.0 else "satisfied"
        robustness = figures.format_quantity(value, each.unit)
        yield each.label, f"{state} with robustness {robustness}. Demands: {each.in_words()}"


def format_event(at_s: float | None) -> str:
    """Return the time of an event, or words for an event that never occurred."""
    return "never" if at_s is None else figures.format_quantity(at_s, "s")


def tabulate_thresholds(measures: Measures, assessed: Assessment) -> tables.Table:
    """Return the safety measures of an episode, their thresholds, and the times of crossing."""
    # Older releases, which did not count clipped steps, did not measure the times either.
    has_times = measures.clipped_steps is not None

    def format_passing(at_s: float | None) -> str | None:
        return format_event(at_s) if has_times or at_s is not None else None

    rows = (
        (
            "MinTTC",
            figures.format_quantity(measures.min_ttc_s, "s"),
            "< 1.5 s",
            format_passing(measures.ttc_violated_s),
            figures.format_quantity(assessed.ttc_lead_s, "s"),
        ),
        (
            "DRAC, largest",
            figures.format_quantity(measures.max_drac_mps2, "m/s²"),
            "> 7 m/s²",
            format_passing(measures.drac_violated_s),
            figures.format_quantity(assessed.drac_lead_s, "s"),
        ),
        (
            "Footprints apart",
            figures.format_quantity(measures.distance_m, "m"),
            "0 m",
            format_event(measures.collided_s),
            None,
        ),
    )
    columns = tables.count_columns("Value", "Threshold", "Passed at", "Before the collision")
    notes = tuple(_describe_drac(measures))
    return tables.Table("Safety measures", (*tables.name_columns("Measure"), *columns), rows, notes)


def _describe_drac(measures: Measures) -> Iterator[str]:
    if measures.drac_at_warning_mps2 is not None:
        drac = figures.format_quantity(measures.drac_at_warning_mps2, "m/s²")
        yield f"When the time to collision first fell below 1.5 s, DRAC was {drac}."
    # Nothing was closing in at the last step if it is 0.
    if measures.final_drac_mps2:
        drac = figures.format_quantity(measures.final_drac_mps2, "m/s²")
        yield f"At the last step DRAC was {drac}."


def describe_minimal_failure(found: MinimalFailure) -> tuple[str, ...]:
    """Return how much noise is needed, its effect, and why it cannot be reduced further."""
    # Noise of zeros has no energy to keep a share of.
    kept = found.energy / found.full_energy if found.full_energy else None
    likelihood, full = (
        f"{figures.format_number(total, LOG_P_DIGITS)} ({{}}{figures.format_number(per_step)})"
        for total, per_step in (
            (found.log_probability, found.log_probability_per_step),
            (found.full_log_probability, found.full_log_probability_per_step),
        )
    )
    needed = (
        f"Minimal failure {found.campaign}/{found.index}: {found.needed} of {found.injected} "
        f"values of noise are needed, {figures.format_share(kept)} of their squares."
    )
    return (
        needed,
        found.words,
        found.because,
        f"log p {likelihood.format('per step ')}; at full strength {full.format('')}.",
        LIKELIER,
    )


ReadStep = Callable[[ExplainedStep], tables.Cell]


def _read_account(name: str) -> ReadStep:
    def read(step: ExplainedStep) -> tables.Cell:
        value = step.account.get(name)
        # A planner reports an empty text for a step about which it has nothing to say.
        return (value or None) if isinstance(value, str) else value

    return read


WORDS: dict[str, ReadStep] = {
    "Mode": _read_account("mode"),
    "Candidate": _read_account("candidate"),
    "Rule": _read_account("rule"),
    "Override": _read_account("override"),
    "QP": _read_account("qp_status"),
    "Heeds": _read_account("heeds"),
}
READINGS: dict[str, ReadStep] = {
    "Vehicle": lambda step: step.vehicle,
    "Gap": _read_account("gap_m"),
    "True gap": lambda step: step.gap_m,
    "Closing": _read_account("closing_mps"),
    "Truly closing": lambda step: step.closing_mps,
    "Tracks": _read_account("tracks"),
    "Lost": _read_account("lost_tracks"),
    "Noise": lambda step: " ".join(map(figures.format_signed, step.disturbance)),
    "Acceleration": lambda step: step.acceleration_mps2,
    "Steering": lambda step: step.steering_rad,
}
UNITS = (
    "Times in s, gaps in m, closing speeds in m/s, noise of each channel in sigma,"
    " acceleration in m/s², steering in rad; gap and closing are what the planner believes of that"
    " vehicle. True figures are of the same one."
)
SHOWN_ABOVE = frozenset(
    (
        "mode",
        "candidate",
        "rule",
        "override",
        "qp_status",
        "heeds",
        "vehicle",
        "gap_m",
        "closing_mps",
        "tracks",
        "lost_tracks",
        "lost_vehicles",
    )
)


SHOW_STEPS = "Show what the planner believed and decided in each step with --steps."


def describe_explanation(explanation: Explanation, *, with_steps: bool) -> tuple[tables.Block, ...]:
    """Return an explained episode: remarks on the replay, the story, and optionally its steps."""
    remarks = [line for line in (explanation.verdict, explanation.note) if line]
    steps = (tabulate_steps(explanation.steps),) if with_steps else (SHOW_STEPS,)
    return (*remarks, "", *explanation.story, "", *steps)


def tabulate_steps(steps: Sequence[ExplainedStep]) -> tables.Table:
    """Return the steps, one a row, without columns that are empty in all steps.

    Each additional value that a planner reports has a separate column.
    """
    others = dict.fromkeys(name for step in steps for name in step.account)
    readings = {"Time": lambda step: step.time_s, **WORDS, **READINGS}
    readings |= {name: _read_account(name) for name in others if name not in SHOWN_ABOVE}
    values = {title: [read(step) for step in steps] for title, read in readings.items()}
    # Columns without a value would push others off a terminal.
    known = {title: cells for title, cells in values.items() if any(x is not None for x in cells)}
    columns = tuple(
        tables.TableColumn(title, is_figure=title not in {*WORDS, "Tracks"}) for title in known
    )
    return tables.Table("Steps", columns, tuple(zip(*known.values(), strict=True)), (UNITS,))
