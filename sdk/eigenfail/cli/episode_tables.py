"""Tables of episodes: a list, and one with what was measured."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from rich.markup import escape
from rich.table import Table

from eigenfail.cli.figures import UNKNOWN, count, number
from eigenfail.cli.tables import facts, table
from eigenfail.client.episodes import Picked
from eigenfail.filters import COLUMNS, Value
from eigenfail.values import Assessment, Measures
from eigenfail.values.records import EpisodeDetail, EpisodeRow


def episode_table(rows: Iterable[EpisodeRow]) -> Table:
    """A list of episodes; robustness in m, severity in m²/s², times in s, DRAC in m/s²."""
    figures = (
        *("steps", "robustness", "log p", "severity"),
        *("min TTC", "max DRAC", "TTC lead", "DRAC lead"),
    )
    names = ("episode", "outcome", "class", *figures, "source", "worker")
    grid = table(*names, right=("episode", *figures))
    for row in rows:
        measured = (
            *(row.robustness_m, row.log_probability, row.severity, row.min_ttc_s),
            *(row.max_drac_mps2, row.assessed.ttc_lead_s, row.assessed.drac_lead_s),
        )
        grid.add_row(
            f"{row.campaign}/{row.index}",
            row.outcome,
            class_of(row.assessed),
            str(row.steps),
            *(number(value) for value in measured),
            row.source,
            escape(row.worker),
        )
    return grid


def picked_table(columns: Sequence[str], rows: Iterable[Picked]) -> Table:
    """Some columns of episodes, under their names."""
    figures = [name for name in columns if COLUMNS[name].is_ordered]
    grid = table(*columns, right=figures)
    for row in rows:
        grid.add_row(*(figure(row[name]) for name in columns))
    return grid


def figure(value: Value | None) -> str:
    """A value of any kind; whole numbers with all of their digits."""
    if value is None:
        return UNKNOWN
    return number(value) if isinstance(value, float) else escape(str(value))


def class_of(assessed: Assessment) -> str:
    """The class beside an outcome, in words."""
    return assessed.beside((assessed.conflict or UNKNOWN).replace("_", " "))


def episode_facts(campaign: int, result: EpisodeDetail, drawn: Mapping[str, Any]) -> Table:
    """One episode with the scenario parameters that it drew, and what was measured."""
    rows = [
        ("episode", f"{campaign}/{result.index}, seed {result.seed}"),
        ("outcome", result.outcome),
        ("class", result.assessed.words or UNKNOWN),
        ("steps", str(result.steps)),
        *(("scenario", f"{name} = {value}") for name, value in drawn.items()),
        ("disturbances", f"from {result.source}, log p {result.noise.log_probability:.2f}"),
        *(measured(result.measures, result.assessed) if result.measures else ()),
        ("scene", "stored" if result.scene else "not stored"),
        ("digest", result.digest()),
    ]
    if result.fault:
        rows.append(("problem", f"{result.fault.kind}: {result.fault.message}"))
    return facts(rows)


def measured(measures: Measures, assessed: Assessment) -> list[tuple[str, str]]:
    """The measures of an episode by name, with their units."""
    figures = {
        "robustness [m]": measures.robustness_m,
        "severity [m²/s²]": measures.severity,
        "min TTC [s]": measures.min_ttc_s,
        "max DRAC [m/s²]": measures.max_drac_mps2,
        "TTC < 1.5 s at [s]": measures.ttc_violated_s,
        "DRAC > 7 m/s² at [s]": measures.drac_violated_s,
        "DRAC at the first of TTC [m/s²]": measures.drac_at_warning_mps2,
        "DRAC at the last step [m/s²]": measures.final_drac_mps2,
        "collision at [s]": measures.collided_s,
        "lead time of TTC [s]": assessed.ttc_lead_s,
        "lead time of DRAC [s]": assessed.drac_lead_s,
        "left the road at [s]": measures.left_road_s,
        "largest jerk [m/s³]": measures.max_jerk_mps3,
    }
    return [
        *((name, number(value, 3)) for name, value in figures.items()),
        ("hard brakings", count(measures.hard_brakings)),
        ("steps beyond the truck", count(measures.clipped_steps)),
    ]
