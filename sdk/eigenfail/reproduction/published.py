"""The numbers that the paper prints, by table, row and column."""

from collections.abc import Mapping
from types import MappingProxyType

Numbers = Mapping[str, float]
Rows = Mapping[str, Numbers]


def rated(rate: float, log_p: float, severity: float) -> Numbers:
    """Failure rate in per cent, mean log p of the failures, mean severity [m²/s²]."""
    return {"failure_rate": rate / 100.0, "log_p": log_p, "severity": severity}


PLANNERS: Rows = MappingProxyType(
    {
        "monte_carlo rulebook": {"failure_rate": 0.0, "severity": 0.0},
        "monte_carlo idm": {"failure_rate": 0.401, "severity": 0.719},
    }
)

SWEEP: Rows = MappingProxyType(
    {
        "sweep base": rated(96, -5360.22, 152.47),
        "sweep alpha=500": rated(45, -2465.45, 137.28),
        "sweep alpha=1000": rated(72, -2124.35, 126.37),
        "sweep alpha=5000": rated(55, -3950.79, 150.77),
        "sweep c_dist=100": rated(93, -7340.49, 145.40),
        "sweep c_dist=5000": rated(98, -7512.87, 165.92),
        "sweep tau=0.001": rated(99, -3218.86, 136.15),
        "sweep tau=0.01": rated(98, -4002.00, 155.10),
        "sweep learning_rate=0.001": rated(3, -1185.76, 122.90),
        "sweep learning_rate=0.0001": rated(96, -5694.37, 188.23),
        "sweep learning_rate=5e-05": rated(3, -1885.44, 119.94),
        "sweep batch_size=16": rated(100, -4014.96, 175.52),
        "sweep batch_size=256": rated(96, -7250.31, 165.64),
        "sweep buffer_size=10000": rated(98, -3861.41, 131.12),
        "sweep buffer_size=1000000": rated(98, -3182.21, 148.69),
    }
)

TRAINING: Rows = MappingProxyType(
    {
        "ast_paper": {**rated(87.7, -4506.13, 152.63), "cost_usd": 0.012},
        "difs_paper": {**rated(2.4, -1495.67, 124.93), "cost_usd": 0.648},
    }
)

EVALUATION: Rows = MappingProxyType(
    {
        "monte_carlo rulebook": {"failure_rate": 0.0},
        "ast_paper evaluation": {**rated(94.6, -2870.26, 164.75), "cost_usd": 0.023},
        "difs_paper evaluation": {**rated(3.1, -1490.71, 115.21), "cost_usd": 0.518},
    }
)

GENERALISATION: Rows = MappingProxyType(
    {
        "ast_paper evaluation": {"failure_rate": 0.946, "severity": 164.75},
        "ast_paper plus5": {"failure_rate": 1.0, "severity": 190.50},
        "ast_paper minus5": {"failure_rate": 1.0, "severity": 174.45},
    }
)

SAFETY: Rows = MappingProxyType(
    {
        "collision": {"count": 9},
        "min_ttc": {"count": 19, "median": 3.50, "worst": 0.015},
        "drac": {"count": 4, "median": 0.40, "worst": 43.633},
    }
)
SAFETY_EPISODES = 300
"""Of DiFS."""

EXPLAINED_BY_THREE = MappingProxyType({"longitudinal": 0.40})

MODES = 3
