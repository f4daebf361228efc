"""What each campaign found, how likely, how bad, and at what price."""

from eigenfail.values.report import Cell, ReportSection
from eigenfail_services.campaigns.comparison_words import by_luck
from eigenfail_services.reports import formats
from eigenfail_services.reports.material import Material, Subject
from eigenfail_services.reports.parts import Part, side_by_side, table

COLUMNS = (
    ("campaign", "Campaign"),
    ("name", "Name"),
    ("method", "Method"),
    ("planner", "Planner"),
    ("scenario", "Scenario"),
    ("state", "State"),
    ("n", "Episodes completed"),
    ("failures", "Failures"),
    ("failure_rate", "Failure rate", "share"),
    ("failure_rate_low", "from", "share"),
    ("failure_rate_high", "to", "share"),
    ("horizon", "Horizon", "s"),
    ("unresolved", "Unresolved at the horizon"),
    ("unresolved_not_known", "Whether unresolved is not known"),
    ("cost_per_failure", "Cost per failure", "USD"),
    ("cost_per_failure_low", "from", "USD"),
    ("cost_per_failure_high", "to", "USD"),
    ("cost_per_failure_at_least", "Cost per failure at least", "USD"),
    ("cost", "Cost", "USD"),
    ("instance_hours", "Instance-hours", "h"),
    ("log_p_per_step", "log p per step of the failures", "nat"),
    ("log_p", "Mean log p of the failures", "nat"),
    ("severity", "Mean severity", "m²/s²"),
    ("probability", "Failure probability"),
    ("probability_low", "from"),
    ("probability_high", "to"),
    ("probability_cv", "Coefficient of variation"),
    ("probability_n", "Episodes it rests on"),
    ("probability_by", "Found by"),
    ("probability_problem", "Why it is not told"),
    ("probability_note", "What it cannot know"),
    ("episodes_per_s", "Episodes per second", "1/s"),
    ("active_s", "Time running", "s"),
)
HOW_TO_READ = (
    "A failure rate is the share of completed episodes with a collision within the horizon. "
    "Intervals hold the true value in 95 % of all cases. Severity is ‖v_ego − v_actor‖² at the "
    "collision. log p is the log-density of the injected noise; per step it can be compared "
    "between episodes of different length, and higher is likelier. Cost is that of computing, not "
    "of collisions."
)


def part(material: Material) -> Part:
    """The results side by side."""
    subjects = material.subjects
    section = ReportSection(
        name="results",
        title="Results",
        words=(*map(sentence, subjects), *by_luck([s.campaign for s in subjects]), HOW_TO_READ),
        tables=(table("results", "Results of the campaigns", COLUMNS, [*map(row, subjects)]),),
    )
    return Part(section, {"results": side_by_side(subjects, FIGURES)})


def row(subject: Subject) -> tuple[Cell, ...]:
    """The numbers of a campaign."""
    campaign, summary = subject.campaign, subject.summary
    spec = campaign.spec
    return (
        *(campaign.id, spec.name, spec.method, spec.planner, spec.scenario, campaign.state.value),
        *(summary.counts.completed, summary.counts.failures),
        *rate_cells(subject),
        *cost_cells(subject),
        summary.log_probability_per_step,
        summary.mean_log_probability,
        summary.mean_severity,
        *probability_cells(subject),
        summary.episodes_per_s,
        campaign.active_s,
    )


def rate_cells(subject: Subject) -> tuple[Cell, ...]:
    """The failure rate and its interval, within which time, and what ended too early to tell."""
    rate, ended = subject.summary.failure_rate, subject.summary.unresolved
    bounds = (rate.value, rate.interval.low, rate.interval.high) if rate else (None,) * 3
    return (*bounds, ended.horizon_s, ended.count, ended.not_known)


def cost_cells(subject: Subject) -> tuple[Cell, ...]:
    """What a failure cost, and all of them."""
    cost = subject.summary.cost
    bounds = (cost.interval_usd.low, cost.interval_usd.high) if cost.interval_usd else (None, None)
    per_failure = (cost.per_failure_usd, *bounds, cost.at_least_usd)
    return (*per_failure, cost.total_usd, cost.instance_hours)


def probability_cells(subject: Subject) -> tuple[Cell, ...]:
    """The failure probability, or why it is not told."""
    found = subject.summary.estimate
    if found is None:
        return (None,) * 8
    bounds = (found.interval.low, found.interval.high) if found.interval else (None, None)
    basis = (found.cv, found.episodes, found.by, found.problem, found.note)
    return (found.probability, *bounds, *basis)


def sentence(subject: Subject) -> str:
    """What a campaign found, in a sentence."""
    summary, spec = subject.summary, subject.campaign.spec
    who = f"Campaign {subject.id}, {spec.name} ({spec.method}, {spec.planner} in {spec.scenario})"
    rate = summary.failure_rate
    if rate is None:
        return f"{who}: no episode has ended yet."
    if not rate.k:
        found = f"no failure in {rate.n:,} episodes; {price(subject)}."
        return f"{who}: {found} {summary.remark}".strip()
    found = f"{rate.k:,} failures in {rate.n:,} episodes"
    share = f"{formats.percent(rate.value)} (95 %: {formats.bounds(rate.interval, 100.0)} %)"
    return f"{who}: {found}, {share}; {price(subject)}. {summary.remark}".strip()


def price(subject: Subject) -> str:
    """What a failure cost, or costs at least."""
    value, bounds = formats.cost_per_failure(subject.summary.cost)
    if subject.summary.counts.failures:
        return f"a failure cost {value} ({bounds})"
    return f"a failure costs at least {value.removeprefix('≥ ')} (95 %)"


def basis(subject: Subject) -> str:
    """How many failures a mean rests on."""
    return f"n = {formats.integer(subject.summary.counts.failures)}"


FIGURES = {
    "Method": lambda s: (s.campaign.spec.method,),
    "State": lambda s: (s.campaign.state.value,),
    "Episodes completed": lambda s: (formats.integer(s.summary.counts.completed),),
    "Failures": lambda s: (formats.integer(s.summary.counts.failures),),
    "Failure rate": lambda s: formats.rate(s.summary.failure_rate),
    "Cost per failure": lambda s: formats.cost_per_failure(s.summary.cost),
    "Cost": lambda s: (
        formats.usd(s.summary.cost.total_usd),
        f"{formats.number(s.summary.cost.instance_hours)} instance-hours",
    ),
    "log p per step of the failures [nat]": lambda s: (
        formats.number(s.summary.log_probability_per_step),
        basis(s),
    ),
    "Mean severity of the failures [m²/s²]": lambda s: (
        formats.number(s.summary.mean_severity),
        basis(s),
    ),
    "Failure probability under p(x)": lambda s: formats.probability(s.summary.estimate),
    "Episodes per second": lambda s: (formats.number(s.summary.episodes_per_s),),
}
