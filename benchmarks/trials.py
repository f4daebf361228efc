"""What benchmarks/claims.py runs: for each trial the names of its figures, and what finds them.

A plug-in's trials stand in plugins/*/benchmarks: a module there has TRIALS, pairs of the beginnings
of names and of what finds the figures, and may have TARGETS.
"""

import sys
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from importlib import import_module
from itertools import product
from types import ModuleType
from typing import Any, NamedTuple

from benchmarks.episode_pool import EpisodePool
from benchmarks.faults.fuzzing import fuzzed
from benchmarks.faults.whole_services import faults, kinds
from benchmarks.figures import ROOT, Figure, Record
from benchmarks.peers import openturns_beside
from benchmarks.peers.comparison import compare_peer
from benchmarks.peers.driven_searches import ADAPTED, DRIVEN, OWN, compare_driven
from benchmarks.peers.peer_tools import PEERS
from benchmarks.peers.simple_searches import PLACES, SEARCHES, compare, list_searches
from benchmarks.speed import parallel, subset_parallel
from benchmarks.targets import TARGETS
from benchmarks.truth import (
    action_length,
    channels,
    drive,
    eigenfailures,
    foreign_stacks,
    intervals,
    paper_steps,
    processors,
    releases,
    requirements,
    splitting,
    trainers,
    transfer,
    unavoidable,
    varied,
)
from benchmarks.truth.curves import Curve
from benchmarks.truth.foreign import found_in_others
from benchmarks.truth.known_answers import clouds, corners, planted
from benchmarks.truth.learning import ast, cem, difs, likely_ast, merge, merge_by_default
from benchmarks.truth.mode_reference import confirmed, plain_monte_carlo
from benchmarks.truth.monte_carlo import calm, frail
from benchmarks.truth.noise_models import PLANNERS, noise_models
from benchmarks.truth.other_scenarios import held_noise, merges, ordinary
from benchmarks.truth.probability import p_fail
from benchmarks.truth.shaped import shaped
from benchmarks.truth.undisturbed import undisturbed, unlit

from eigenfail import plugins

SCENARIOS = ("cut_in", "merge_in", "lead_brake")

Finding = Figure | tuple[Curve, ...] | Record
Find = Callable[[EpisodePool, int], Iterable[tuple[str, Finding]]]


class Trial(NamedTuple):
    """Episodes that give figures, and how the names of these begin."""

    prefixes: tuple[str, ...]
    find: Find
    missing: tuple[str, ...] = ()
    """Packages and methods that it needs and that are not installed: its figures stay as found."""

    def concerns(self, prefix: str) -> bool:
        """Whether one of its figures may begin like this."""
        return any(own.startswith(prefix) or prefix.startswith(own) for own in self.prefixes)


def of_planner(name: str, find: Callable[..., Any], scenario: str, planner: str) -> Trial:
    """A trial of a planner in a scenario."""
    return Trial((f"{scenario}.{planner}.{name}.",), partial(find, scenario, planner))


def list_missing_methods(method: str) -> tuple[str, ...]:
    """The method, if no package that is installed brings it."""
    return () if method in plugins.names(plugins.METHODS) else (f"method {method}",)


def import_plugin_benchmarks() -> Iterator[ModuleType]:
    """Yield the modules under plugins/ that have trials."""
    for file in sorted(ROOT.glob("plugins/*/benchmarks/*.py")):
        if str(file.parent) not in sys.path:
            sys.path.append(str(file.parent))
        module = import_module(file.stem)
        if hasattr(module, "TRIALS"):
            yield module


TRIALS = [
    Trial(("cut_in.rulebook.mc2000.",), partial(calm, "cut_in")),
    Trial(("cut_in.idm.mc2000.",), partial(frail, "cut_in")),
    Trial(("cut_in.rulebook.p_fail",), partial(p_fail, "cut_in")),
    Trial(("cut_in.p_fail",), splitting.find),
    Trial(
        (
            *("cut_in.rulebook.held", "cut_in.rulebook.white", "cut_in.rulebook.square3."),
            *("cut_in.rulebook.wave2", "cut_in.shaped."),
        ),
        shaped,
    ),
    Trial(("cut_in.ast.",), ast),
    Trial(("cut_in.ast_", "cut_in.heuristic."), likely_ast),
    Trial(("ast_parallel_",), parallel.find_figures),
    Trial(("subset_busy_",), subset_parallel.find_busy),
    Trial(("subset_parallel_",), subset_parallel.find_estimates),
    Trial(
        ("ast.transfer.", "ast.transfer_worst", "ast.transfer_median"),
        transfer.over_a_distribution,
    ),
    *(
        Trial(
            (f"ast.one_scenario_{name}.", f"ast.transfer_{name}_"),
            partial(transfer.from_one_scenario, name),
        )
        for name in transfer.RECIPES
    ),
    Trial(("ast.length.",), action_length.find),
    Trial(("ast.merge_in_worst",), merge_by_default),
    Trial(("ast.fast_equals_sb3",), trainers.find_difference),
    Trial(("paper.steps",), paper_steps.find_steps),
    Trial(("paper_steps.",), paper_steps.find_figures),
    Trial(("unavoidable.",), unavoidable.find),
    Trial(("cut_in.difs", "cut_in.cem_held_back."), difs),
    Trial(("cut_in.cem.",), cem),
    Trial(("merge_in.rulebook.mc2000.",), partial(calm, "merge_in")),
    Trial(("merge_in.idm.mc2000.",), partial(frail, "merge_in")),
    Trial(("merge_in.ast.",), partial(merge, "ast", patience=None)),
    Trial(("merge_in.difs.",), partial(merge, "difs")),
    Trial(("eigenfailures.",), eigenfailures.reproduce),
    Trial(("cut_in.true_failures.",), confirmed),
    Trial(("cut_in.rulebook.plain_monte_carlo.",), plain_monte_carlo),
    Trial(("bridges.",), found_in_others),
    *(
        Trial(
            (f"foreign.{name}.",),
            partial(foreign_stacks.find, name),
            foreign_stacks.list_missing(stack),
        )
        for name, stack in foreign_stacks.STACKS.items()
    ),
    Trial(("cut_in.idm.varied.",), partial(varied.idm, "cut_in", varied.IDM_IN_CUT_IN)),
    Trial(("merge_in.idm.varied.",), partial(varied.idm, "merge_in", varied.IDM_IN_MERGE_IN)),
    Trial(("cut_in.rulebook.varied.",), varied.rulebook),
    Trial(("cut_in.noise.",), noise_models),
    Trial(("joint.log_p_gain",), channels.find_joint_gain),
    Trial(("joint.interval_cover",), channels.find_joint_cover),
    Trial(("channels.white_",), channels.find_equal_digests),
    Trial(("channels.conformance",), channels.find_conformance),
    Trial(("channels.cut_in.", "channels.merge_in."), channels.find),
    Trial(("importance.",), requirements.find_importance),
    Trial(("releases.",), releases.find_figures),
    Trial(("requirements.closed_form.",), requirements.find_closed_form),
    Trial(("requirements.merge_in.uncaused_braking.",), requirements.find_searches),
    Trial(
        tuple(f"requirements.{one}.{other}." for one, other in product(SCENARIOS, PLANNERS)),
        requirements.find_rates,
    ),
    *(of_planner("undisturbed", undisturbed, *place) for place in product(SCENARIOS, PLANNERS)),
    Trial(("lead_brake.rulebook.unlit.",), unlit),
    Trial(("drive.modes_ari",), drive.find_agreement),
    Trial(("drive.undisturbed",), drive.find_undisturbed),
    Trial(("drive.worse.",), drive.find_worse),
    Trial(
        (
            "drive.p_fail",
            "drive.labels",
            "drive.cause.",
            "drive.track_lost",
            "drive.last_tenth",
            "drive.mc2000.",
        ),
        drive.find_p_fail,
    ),
    *(of_planner("held3", held_noise, *place) for place in product(SCENARIOS[1:], PLANNERS)),
    *(of_planner("mc300", ordinary, "lead_brake", planner) for planner in PLANNERS),
    *(Trial((f"merge_in.{one}.merges.",), partial(merges, one)) for one in PLANNERS),
    Trial(("analysis.planted.",), planted),
    Trial(("analysis.one_cloud.",), clouds),
    Trial(("two_corners.",), corners),
    *(
        Trial(
            (f"search.{place}.{name}.",),
            partial(compare, place, name),
            list_missing_methods(SEARCHES[name][0]),
        )
        for place in PLACES
        for name in list_searches(place)
    ),
    *(
        Trial(
            (f"search.{place}.{name}.",),
            partial(compare_driven, place, name),
            (
                *foreign_stacks.list_missing_package(where.package),
                *list_missing_methods(method),
            ),
        )
        for place, where in DRIVEN.items()
        for name, (method, _) in (OWN | ADAPTED).items()
    ),
    *(
        Trial(
            (f"search.{place}.{name}.",),
            partial(compare_peer, place, name),
            tuple(peer.list_missing()),
        )
        for place, (name, peer) in product(PLACES, PEERS.items())
    ),
    Trial(("intervals.splitting.",), intervals.find_splitting_figures),
    Trial(
        (
            *("intervals.covered_min", "intervals.low_bias_worst"),
            *("intervals.told_share", "intervals.mixture_over_subset"),
        ),
        intervals.find_figures,
    ),
    Trial(
        ("subset_over_openturns",),
        openturns_beside.find_figures,
        openturns_beside.list_missing(),
    ),
    Trial(("cross_processor_equal",), processors.find_figures),
    Trial(("fuzz.",), fuzzed),
    Trial(("faults.kinds",), kinds),
    Trial(
        (
            *("faults.injected", "faults.lost", "faults.doubled", "faults.complaints"),
            *("faults.digest_equal", "faults.storm."),
        ),
        faults,
    ),
]

for plugin in import_plugin_benchmarks():
    TRIALS += [Trial(prefixes, find) for prefixes, find in plugin.TRIALS]
    TARGETS.update(getattr(plugin, "TARGETS", {}))
