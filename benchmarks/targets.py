"""What the claims are held against."""

from collections.abc import Mapping
from math import inf
from typing import NamedTuple

import msgspec
from benchmarks.figures import Figure

OF_IDM = "the paper gives no number of episodes"
OF_AVERAGE = "the paper does not name the episodes of its average"
OF_DIFS = "the paper's is of DiFS runs"
OF_AST = "the paper's is of AST, trained at the default distance"


class Target(NamedTuple):
    """The bounds of a claim, the paper's number, and what must be said of that."""

    low: float = -inf
    high: float = inf
    paper: float | None = None
    note: str = ""

    def words(self) -> str:
        """The bounds as a reader writes them."""
        if self.high == 0.0:
            return "= 0"
        if self.low == -inf:
            return "" if self.high == inf else f"<= {self.high:g}"
        return f">= {self.low:g}" if self.high == inf else f"{self.low:g} … {self.high:g}"

    def held(self, value: float | None) -> bool:
        """Whether a value lies in the bounds; no value lies in none."""
        return value is not None and self.low <= value <= self.high


TARGETS = {
    "cut_in.rulebook.mc2000.failures": Target(high=0.0, paper=0.0),
    "cut_in.idm.mc2000.failure_rate": Target(low=0.25, high=0.55, paper=0.401, note=OF_IDM),
    "cut_in.idm.mc2000.mean_severity": Target(paper=0.72, note=OF_AVERAGE),
    "cut_in.rulebook.mc2000.median_min_ttc_s": Target(low=2.5, paper=3.50, note=OF_DIFS),
    "cut_in.rulebook.mc2000.median_drac": Target(high=1.5, paper=0.40, note=OF_DIFS),
    "cut_in.rulebook.p_fail": Target(low=1e-6, high=5e-4),
    "cut_in.rulebook.held3.rate": Target(paper=0.946, note=OF_AST),
    "cut_in.rulebook.held3.rate_minus_5m": Target(paper=1.0, note=OF_AST),
    "cut_in.rulebook.held3.rate_plus_5m": Target(paper=1.0, note=OF_AST),
    "cut_in.shaped.mean_severity": Target(low=60.0, paper=165.0, note="the paper's is of AST"),
    "cut_in.ast.train1000.failure_rate": Target(low=0.85, paper=0.877),
    "cut_in.ast.first_failure_episode": Target(high=150.0),
    "cut_in.ast.eval300.failure_rate": Target(low=0.96, paper=0.946),
    "cut_in.ast.eval300.mean_severity": Target(low=100.0, paper=165.0),
    "cut_in.ast.plus5.failure_rate": Target(low=0.95, paper=1.0),
    "cut_in.ast.minus5.failure_rate": Target(low=0.95, paper=1.0),
    "cut_in.ast_over_heuristic": Target(low=1.2),
    "ast_parallel_100_failures": Target(low=0.88),
    "cut_in.difs.eval300.failure_rate": Target(low=0.10, paper=0.031),
    "cut_in.difs.eval300.mean_severity": Target(paper=115.0),
    "cut_in.difs.default_less_ddpm1000.failure_rate": Target(low=-0.05),
    "merge_in.ast.failures": Target(low=1.0),
    "merge_in.difs.failures": Target(low=1.0),
    "merge_in.rulebook.mc2000.failures": Target(high=0.0),
    "merge_in.idm.mc2000.failure_rate": Target(low=0.05),
    "cut_in.noise.white.rulebook.failure_rate": Target(high=0.005),
    "cut_in.noise.white.idm.failure_rate": Target(low=0.20),
    "cut_in.rulebook.undisturbed.hardest_braking": Target(high=2.0),
    "cut_in.rulebook.undisturbed.largest_jerk": Target(high=4.01),
    "cut_in.rulebook.undisturbed.slowest_mps": Target(low=10.0),
    "cut_in.rulebook.undisturbed.steps_not_as_planned": Target(high=0.0),
    **{
        f"{place}.undisturbed.collisions": Target(high=0.0)
        for place in (
            "cut_in.rulebook",
            "cut_in.idm",
            *("merge_in.rulebook", "merge_in.idm"),
            *("lead_brake.rulebook", "lead_brake.idm"),
        )
    },
    "drive.p_fail": Target(low=1e-4, high=1e-3),
    "drive.modes_ari": Target(low=0.8),
    "drive.modes_ari.mechanisms": Target(low=0.8),
    "drive.labels": Target(low=3.0),
    "drive.undisturbed": Target(high=0.0),
    "drive.last_tenth": Target(high=0.2),
    "ast.transfer_worst": Target(low=0.9),
    "ast.transfer_alpha_600_worst": Target(low=0.9),
    "ast.merge_in_worst": Target(low=0.5),
    "ast.fast_equals_sb3": Target(high=1e-6),
    "paper.steps": Target(low=600.0),
    "unavoidable.undisturbed.collisions": Target(high=0.0),
    "unavoidable.mc2000.collisions": Target(high=0.0),
    **{f"unavoidable.paper_brakes.{method}": Target(high=0.0) for method in ("held", "cma", "ast")},
    "unavoidable.share.held": Target(low=0.1, high=0.9),
    "unavoidable.share.cma": Target(low=0.1, high=0.9),
    "paper_steps.all.white.failure_rate": Target(high=0.0, paper=0.0),
    "intervals.covered_min": Target(low=0.93),
    "intervals.low_bias_worst": Target(low=0.8),
    "foreign.stacks": Target(low=4.0),
    "search.dominated": Target(high=0.0),
    "subset_busy_100": Target(low=0.85),
    "subset_parallel_covered": Target(low=0.93),
    "subset_parallel_error": Target(high=1.1),
    "subset_over_openturns_worst": Target(high=1.1),
    "channels.white_digest_equal": Target(low=1.0),
    "channels.conformance": Target(low=1.0),
    "releases.planted_f1": Target(low=0.95),
    "releases.false_new": Target(high=0.05),
    "releases.false_gone": Target(high=0.05),
    "requirements.closed_form.covered": Target(low=0.93),
    "joint.interval_cover": Target(low=0.9),
    "joint.log_p_gain": Target(low=0.0),
    "faults.kinds": Target(low=40.0),
    "faults.storm.kinds": Target(low=13.0),
    "faults.injected": Target(low=120.0),
    "faults.lost": Target(high=0.0),
    "faults.doubled": Target(high=0.0),
    "faults.complaints": Target(high=0.0),
    "faults.digest_equal": Target(low=1.0),
    "fuzz.messages": Target(low=100_000.0),
    "fuzz.escapes": Target(high=0.0),
}
"""Targets of the figures of the core; trials.py adds the targets of plug-ins."""


def add_target(name: str, figure: Figure, seed: int) -> Figure:
    """A figure with its target, the paper's number and the seed of its noise."""
    target = TARGETS.get(name, Target())
    paper = figure.paper if target.paper is None else target.paper
    notes = [note for note in (figure.note, target.note, f"seed {seed}") if note]
    return msgspec.structs.replace(
        figure, target=target.words(), paper=paper, note="; ".join(notes)
    )


def list_missed(figures: Mapping[str, Figure], prefix: str) -> list[str]:
    """The names that begin with a prefix, and are outside their targets or not there at all."""
    values = {name: figure.value for name, figure in figures.items()}
    return [
        name
        for name, target in TARGETS.items()
        if name.startswith(prefix) and target.words() and not target.held(values.get(name))
    ]
