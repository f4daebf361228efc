"""Contracts between the parts of eigenfail, and of plug-ins.

Each contract has a conformance suite in `eigenfail.testing`, but for the formats of
`eigenfail.contracts.recording`.
"""

from eigenfail.contracts.learning import (
    Estimator,
    Exploiter,
    Injection,
    Learner,
    Method,
    MethodTraits,
    ModeProbability,
    Paced,
    Reference,
    Trained,
)
from eigenfail.contracts.world import (
    EpisodeEngine,
    Explainer,
    ExplainingPlanner,
    LockstepEngine,
    Planner,
    PlannerPlugin,
    PlottingPlanner,
    ReactiveSituation,
    Scenario,
    SignallingPlanner,
    Simulation,
    Simulator,
    Situation,
    TrackingPlanner,
    TrafficModel,
)

__all__ = [
    "EpisodeEngine",
    "Estimator",
    "Explainer",
    "ExplainingPlanner",
    "Exploiter",
    "Injection",
    "Learner",
    "LockstepEngine",
    "Method",
    "MethodTraits",
    "ModeProbability",
    "Paced",
    "Planner",
    "PlannerPlugin",
    "PlottingPlanner",
    "ReactiveSituation",
    "Reference",
    "Scenario",
    "SignallingPlanner",
    "Simulation",
    "Simulator",
    "Situation",
    "TrackingPlanner",
    "TrafficModel",
    "Trained",
]
