"""What was measured over an episode, in words and figures."""

from math import sqrt

from eigenfail.values import Assessment, EpisodeResult, Measures, assess
from eigenfail_api.dashboard import formats

Facts = tuple[tuple[str, str], ...]

NOT_CLASSIFIED = "not classified"
NEVER = "never"


def facts(result: EpisodeResult, dt_s: float | None) -> Facts:
    """What the episode was, and where it came from."""
    measures, steps = result.measures, result.steps
    lasted = f" ({formats.number(steps * dt_s)} s)" if dt_s else ""
    likelihood = result.noise.log_probability
    assessed = assess(result.outcome, measures)
    return (
        ("Steps", f"{steps}{lasted}"),
        *(danger(measures, assessed) if measures else ()),
        ("log p", formats.number(likelihood, 5)),
        ("log p per step", formats.number(likelihood / max(steps, 1))),
        ("Disturbance source", result.source),
        ("Seed", str(result.seed)),
        ("Computed in", formats.duration(result.wall_s)),
    )


def danger(measures: Measures, assessed: Assessment) -> Facts:
    """How near it came to a collision, and when that could be seen."""
    return (
        ("Class", assessed.words or NOT_CLASSIFIED),
        ("Robustness", unit(measures.robustness_m, "m")),
        ("Severity", severity(measures.severity)),
        ("MinTTC", unit(measures.min_ttc_s, "s")),
        ("Largest DRAC", unit(measures.max_drac_mps2, "m/s²")),
    )


def ride(result: EpisodeResult) -> Facts:
    """When thresholds were passed, and how rough the ride was; nothing if that was not measured."""
    measures = result.measures
    if measures is None or measures.clipped_steps is None:
        return ()
    assessed = assess(result.outcome, measures)
    return (
        ("TTC below 1.5 s", since(measures.ttc_violated_s, assessed.ttc_lead_s)),
        ("DRAC at that moment", unit(measures.drac_at_warning_mps2, "m/s²")),
        ("DRAC above 7 m/s²", since(measures.drac_violated_s, assessed.drac_lead_s)),
        ("Left the road", since(measures.left_road_s, None)),
        ("Largest jerk", unit(measures.max_jerk_mps3, "m/s³")),
        ("Hard brakings", whole(measures.hard_brakings)),
        ("Controls clipped", f"{whole(measures.clipped_steps)} steps"),
    )


def since(at_s: float | None, lead_s: float | None) -> str:
    """When it happened first, and how long before the collision."""
    if at_s is None:
        return NEVER
    lead = "" if lead_s is None else f", {unit(lead_s, 's')} before the collision"
    return f"at {unit(at_s, 's')}{lead}"


def unit(value: float | None, name: str) -> str:
    """A figure with its unit, or a dash."""
    return formats.NONE if value is None else f"{formats.number(value)} {name}"


def whole(value: int | None) -> str:
    """A count, or a dash."""
    return formats.NONE if value is None else formats.integer(value)


def severity(value: float | None) -> str:
    """Severity, and the relative speed that it is the square of."""
    if value is None:
        return formats.NONE
    return f"{formats.number(value)} m²/s² (relative speed {formats.number(sqrt(value))} m/s)"
