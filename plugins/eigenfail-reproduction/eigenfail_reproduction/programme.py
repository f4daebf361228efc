"""The paper's experiments, as campaigns of one suite for each scenario."""

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any

import msgspec

from eigenfail.errors import UnknownName
from eigenfail.suites import Suite, SuiteMember
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.channels import Channel
from eigenfail.values.disturbance import AXES, DisturbanceModel
from eigenfail.values.requirements import AnyRequirement, MeasureLimit

FRESH = 1000
"""Added to a seed: what was learnt is evaluated on draws that training never saw."""

GRADIENT_STEPS = 4
"""Of AST with the paper's settings, for each decision; the paper gives no number."""

SWEPT: Mapping[str, Any] = MappingProxyType(
    {
        "alpha": 10_000,
        "c_dist": 1000,
        "tau": 0.005,
        "learning_rate": 3e-4,
        "batch_size": 64,
        "buffer_size": 100_000,
        "gradient_steps": GRADIENT_STEPS,
    }
)
"""Settings of the paper's sweep; all others are those of the programme, `LAST_POLICY`, or
our defaults."""

SWEEP: Mapping[str, tuple[Any, ...]] = MappingProxyType(
    {
        "alpha": (500, 1000, 5000),
        "c_dist": (100, 5000),
        "learning_rate": (1e-3, 1e-4, 5e-5),
        "batch_size": (16, 256),
        "tau": (0.001, 0.01),
        "buffer_size": (10_000,),
    }
)
"""Each varied alone, except for the paper's buffer of 1,000,000, which is left out."""

CHOSEN: Mapping[str, Any] = MappingProxyType(
    {
        "alpha": 5000,
        "c_dist": 1000,
        "tau": 0.001,
        "learning_rate": 3e-4,
        "batch_size": 16,
        "buffer_size": 10_000,
        "gradient_steps": GRADIENT_STEPS,
    }
)
"""What the paper chose for its main runs."""

LAST_POLICY: Mapping[str, Any] = MappingProxyType({"averaged": 1, "converged_share": 1.0})
"""Training ends after 100 failures in a row, or with the campaign. An evaluation runs the policy of
that time, because the paper does not average policies."""

HELD_S = 1.0
"""Duration of an action, and of one draw of held noise."""

LEARNERS = ("ast", "ast_paper", "difs", "difs_paper")
"""Searches with our settings, and with the paper's."""


class ScenarioProgramme(msgspec.Struct, frozen=True, kw_only=True):
    """The paper's experiments in one scenario.

    Attributes:
        name: first words of the suite's name.
        scenario: name of the scenario.
        parameters: parameters of the scenario in which every training takes place.
        moved: parameters of the similar scenarios that AST's policy is also evaluated in, by the
            last word of the member's name.
        step_s: duration of a step. [s]
        planners: settings of each planner, by its name.
        ours: settings of `ast` besides its defaults and `LAST_POLICY`.
        papers: settings of `ast_paper` and of the sweep that the paper does not vary.
        actions: number of the paper's actions that one of ours replaces. Buffers of the sweep are
            smaller by this factor, so that they hold as many episodes as the paper's.
        every_vehicle: whether the noise is on every vehicle; otherwise it is on the nearest one.
        importance: what searches follow in episodes without a collision; None: the smallest
            distance to another vehicle, as in the paper.
    """

    name: str
    scenario: str
    parameters: Mapping[str, float]
    moved: Mapping[str, Mapping[str, float]]
    step_s: float
    planners: Mapping[str, Mapping[str, Any]] = MappingProxyType({})
    ours: Mapping[str, Any] = MappingProxyType({})
    papers: Mapping[str, Any] = MappingProxyType({})
    actions: int = 1
    every_vehicle: bool = False
    importance: AnyRequirement | None = None

    @property
    def axes(self) -> tuple[str, str]:
        """Names of the longitudinal and the lateral noise in analyses."""
        return EVERY_AXES if self.every_vehicle else AXES

    @property
    def hold(self) -> int:
        """Number of steps for which an action stays."""
        return round(HELD_S / self.step_s)

    @property
    def learners(self) -> Mapping[str, tuple[str, Mapping[str, Any]]]:
        """Method and settings of each of `LEARNERS`."""
        return {
            "ast": ("ast", {**LAST_POLICY, **self.ours}),
            "ast_paper": ("ast", {**LAST_POLICY, **CHOSEN, **self.papers}),
            "difs": ("difs", {}),
            "difs_paper": ("difs", {"schedule": "paper"}),
        }

    def plan_swept(self, **varied: Any) -> dict[str, Any]:
        """Return the settings of the sweep's base, or of a row that varies one of them."""
        settings = {**LAST_POLICY, **SWEPT, **self.papers, **varied}
        return settings | {"buffer_size": settings["buffer_size"] // self.actions}


EVERY_AXES = ("every.longitudinal", "every.lateral")

STEP_S = 0.02
"""Duration of a step of `cut_in`. [s]"""

HOLD = round(HELD_S / STEP_S)
"""Number of steps of an action of `cut_in`."""

FREQUENCY = 5
"""Measurements for each one of the default step of 0.1 s."""

PROGRAMMES: Mapping[str, ScenarioProgramme] = MappingProxyType(
    {
        "cut_in": ScenarioProgramme(
            name="paper",
            scenario="cut_in",
            parameters={
                "distance_m": 58.0,
                "dt_s": STEP_S,
                "duration_s": 14.0,
                "initial_gap_m": 140.0,
            },
            moved={"plus5": {"distance_m": 63.0}, "minus5": {"distance_m": 53.0}},
            step_s=STEP_S,
            planners={
                "rulebook": {
                    "tracker": {
                        "misses_to_delete": 8 * FREQUENCY,
                        "hits_to_confirm": 5 * FREQUENCY,
                        "tentative_misses": 2 * FREQUENCY,
                        "range_acceleration_mps2": 0.6708,
                        "lateral_acceleration_mps2": 0.3354,
                    },
                    "intent": {"commit": 5 * FREQUENCY},
                }
            },
            ours={"hold": HOLD, "alpha": 2100.0, "c_dist": 210.0, "entropy": 280.0},
            papers={
                "hold": HOLD,
                "n_step": 1,
                "gamma": 0.99,
                "patience": None,
                "trainer": "sb3",
            },
            actions=HOLD,
        ),
        "highway_drive": ScenarioProgramme(
            name="paper highway_drive",
            scenario="highway_drive",
            parameters={"follower_gap_m": 9.0, "slow_gap_m": 78.5, "cut_in_distance_m": 57.0},
            moved={
                "farther": {"follower_gap_m": 10.0, "slow_gap_m": 80.0, "cut_in_distance_m": 60.0},
                "nearer": {"follower_gap_m": 8.0, "slow_gap_m": 77.0, "cut_in_distance_m": 54.0},
            },
            step_s=0.1,
            every_vehicle=True,
            importance=MeasureLimit(measure="min_ttc_s", at_least=0.0),
        ),
    }
)
"""By scenario. `cut_in` has the number of steps that the paper's log p implies: 700, of 0.02 s
(`examples/paper_steps.toml`). Sensors measure five times as often as with steps of 0.1 s: the
counts of the tracker are five times as large, and its noise of acceleration is √5 times as large,
so that both are the same per second. An action lasts a second, as with the default settings and
steps of 0.1 s. Log p of an episode is seven times as large, and so are our penalties for no failure
and our initial entropy.

On `highway_drive` there is the paper's noise on every vehicle, and all gaps are moved together, as
far as their bounds allow.

Searches on `highway_drive` follow the smallest time to collision: the smallest distance is the same
in every drive without a collision, that of the car that passes in the next lane, and leads nowhere.
"""


class ProgrammeScale(msgspec.Struct, frozen=True):
    """Number of episodes of each kind of campaign, and the default seed; 0: no such campaign."""

    seed: int
    monte_carlo: int
    sweep: int
    training: int
    evaluation: int
    moved: int


SCALES: Mapping[str, ProgrammeScale] = MappingProxyType(
    {
        "full": ProgrammeScale(
            seed=20261122, monte_carlo=2000, sweep=300, training=1000, evaluation=300, moved=100
        ),
        "small": ProgrammeScale(
            seed=1, monte_carlo=300, sweep=120, training=300, evaluation=100, moved=50
        ),
        "learners": ProgrammeScale(
            seed=20261123, monte_carlo=0, sweep=0, training=300, evaluation=100, moved=50
        ),
    }
)
"""`full` has the paper's numbers of episodes; `learners` are those of `small` that are trained."""


def build_suite(scale: str, seed: int | None = None, scenario: str = "cut_in") -> Suite:
    """Build the suite of the paper's campaigns; evaluations name the member that they evaluate.

    Args:
        scale: a name in `SCALES`.
        seed: seed of every campaign; evaluations draw from one that is 1000 higher. None: the
            scale's.
        scenario: a name in `PROGRAMMES`.

    Raises:
        UnknownName: no such scale, or no programme for that scenario.
    """
    if scale not in SCALES:
        raise UnknownName("scale", scale, SCALES)
    programme, episodes = find_programme(scenario), SCALES[scale]
    name = f"{programme.name} {scale}"
    members = (
        *_plan_draws(programme, episodes),
        *_plan_sweep(programme, episodes),
        *_plan_learners(programme, episodes),
        *_plan_evaluations(programme, episodes),
    )
    chosen = episodes.seed if seed is None else seed
    return Suite(name, tuple(_make_member(programme, name, chosen, *one) for one in members))


def find_programme(scenario: str) -> ScenarioProgramme:
    """Return the programme of a scenario.

    Raises:
        UnknownName: there is none.
    """
    if scenario not in PROGRAMMES:
        raise UnknownName("scenario", scenario, PROGRAMMES)
    return PROGRAMMES[scenario]


MemberFields = tuple[str, dict[str, Any]]


def _plan_draws(programme: ScenarioProgramme, scale: ProgrammeScale) -> Iterator[MemberFields]:
    """Plan noise without learning: from p(x) for each planner, and held for a second."""
    if not scale.monte_carlo:
        return
    for planner in ("rulebook", "idm"):
        yield (
            f"monte_carlo {planner}",
            {"method": "monte_carlo", "planner": planner, "episodes": scale.monte_carlo},
        )
    yield "held", _plan_training("held", {"hold": programme.hold}, scale.monte_carlo)


def _plan_sweep(programme: ScenarioProgramme, scale: ProgrammeScale) -> Iterator[MemberFields]:
    if not scale.sweep:
        return
    yield "sweep base", _plan_training("ast", programme.plan_swept(), scale.sweep)
    for name, values in SWEEP.items():
        for value in values:
            settings = programme.plan_swept(**{name: value})
            yield f"sweep {name}={value}", _plan_training("ast", settings, scale.sweep)


def _plan_learners(programme: ScenarioProgramme, scale: ProgrammeScale) -> Iterator[MemberFields]:
    for name, (method, settings) in programme.learners.items():
        yield name, _plan_training(method, settings, scale.training)


def _plan_evaluations(
    programme: ScenarioProgramme, scale: ProgrammeScale
) -> Iterator[MemberFields]:
    """Plan the evaluation of each learner, and of AST in similar scenarios."""
    for name in LEARNERS:
        yield f"{name} evaluation", _plan_evaluation(name, scale.evaluation, programme.parameters)
    for name in ("ast", "ast_paper"):
        for place, moved in programme.moved.items():
            given = {**programme.parameters, **moved}
            yield f"{name} {place}", _plan_evaluation(name, scale.moved, given)


def _plan_training(method: str, settings: Mapping[str, Any], episodes: int) -> dict[str, Any]:
    return {"method": method, "settings": dict(settings), "episodes": episodes}


def _plan_evaluation(name: str, episodes: int, parameters: Mapping[str, float]) -> dict[str, Any]:
    return {
        "method": "evaluate",
        "settings": {"campaign": name},
        "episodes": episodes,
        "scenario_parameters": dict(parameters),
    }


def _make_member(
    programme: ScenarioProgramme, suite: str, seed: int, name: str, fields: Mapping[str, Any]
) -> SuiteMember:
    usual = {
        "scenario": programme.scenario,
        "scenario_parameters": dict(programme.parameters),
        "planner_settings": programme.planners.get(fields.get("planner", "rulebook"), {}),
        "seed": seed + FRESH if fields["method"] == "evaluate" else seed,
        "disturbance": _make_disturbance(programme),
    }
    if programme.importance is not None:
        usual["importance"] = programme.importance
    return SuiteMember(name, CampaignSpec(name=f"{suite}: {name}", **{**usual, **fields}))


def _make_disturbance(programme: ScenarioProgramme) -> DisturbanceModel:
    if not programme.every_vehicle:
        return DisturbanceModel()
    return DisturbanceModel(channels=tuple(map(Channel, EVERY_AXES)))
