"""What was measured over an episode, in words and figures."""

from math import sqrt

from eigenfail.values import Assessment, EpisodeResult, Measures, assess
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.likelihood import reference
from eigenfail_api.dashboard.views.findings import Grid

Facts = tuple[tuple[str, str], ...]

NOT_CLASSIFIED = "not classified"
NEVER = "never"


def facts(result: EpisodeResult, dt_s: float | None) -> Facts:
    """What the episode was, and where it came from."""
    measures, steps = result.measures, result.steps
    lasted = f" ({formats.number(steps * dt_s)} s)" if dt_s else ""
    assessed = assess(result.outcome, measures)
    return (
        ("Steps", f"{steps}{lasted}"),
        *(danger(measures, assessed) if measures else ()),
        *likelihood(result),
        ("Disturbance source", result.source),
        ("Seed", str(result.seed)),
        ("Computed in", formats.duration(result.wall_s)),
    )


def likelihood(result: EpisodeResult) -> Facts:
    """log p of the noise, and of typical noise over the same steps; nothing before the first."""
    held_against = reference([result.noise])
    if held_against is None:
        return ()
    total, steps = result.noise.log_probability, result.steps
    typical, none = held_against.typical, held_against.none
    return (
        ("log p", f"{formats.number(total, 5)} nats"),
        ("log p per step", f"{formats.number(total / steps)} nats"),
        (
            "Typical log p per step",
            f"{formats.number(typical)} nats, {formats.number(none)} without noise",
        ),
    )


def danger(measures: Measures, assessed: Assessment) -> Facts:
    """How near it came to a collision."""
    return (
        ("Class", assessed.words or NOT_CLASSIFIED),
        ("Robustness", unit(measures.robustness_m, "m")),
        ("Severity", severity(measures.severity)),
    )


def thresholds(result: EpisodeResult) -> Grid | None:
    """The safety measures, their thresholds, and when these were passed; None if not measured."""
    measures = result.measures
    if measures is None:
        return None
    assessed = assess(result.outcome, measures)
    ttc_s, drac_mps2 = unit(measures.min_ttc_s, "s"), unit(measures.max_drac_mps2, "m/s²")
    leads = (unit(assessed.ttc_lead_s, "s"), unit(assessed.drac_lead_s, "s"))
    rows = (
        ("MinTTC", ttc_s, "< 1.5 s", passed(measures.ttc_violated_s, measures), leads[0]),
        (
            "DRAC, largest",
            drac_mps2,
            "> 7 m/s²",
            passed(measures.drac_violated_s, measures),
            leads[1],
        ),
        (
            "Footprints apart",
            unit(measures.robustness_m, "m"),
            "0 m",
            when(measures.collided_s),
            formats.NONE,
        ),
    )
    note = ""
    if measures.drac_at_warning_mps2 is not None:
        at_warning = unit(measures.drac_at_warning_mps2, "m/s²")
        note = f"When the time to collision first fell below 1.5 s, DRAC was {at_warning}."
    if measures.final_drac_mps2:
        note = f"{note} At the last step it was {unit(measures.final_drac_mps2, 'm/s²')}.".strip()
    return Grid("Safety measures", THRESHOLDS, rows, note)


THRESHOLDS = ("Measure", "Value", "Threshold", "Passed at", "Before the collision")


def passed(at_s: float | None, measures: Measures) -> str:
    """When a threshold was first passed; a dash where older releases did not measure it."""
    was_measured = measures.clipped_steps is not None or at_s is not None
    return when(at_s) if was_measured else formats.NONE


def when(at_s: float | None) -> str:
    """A moment, or that it never came."""
    return NEVER if at_s is None else unit(at_s, "s")


def ride(result: EpisodeResult) -> Facts:
    """How rough the ride was; nothing if that was not measured."""
    measures = result.measures
    if measures is None or measures.clipped_steps is None:
        return ()
    return (
        ("Left the road", when(measures.left_road_s)),
        ("Largest jerk", unit(measures.max_jerk_mps3, "m/s³")),
        ("Hard brakings", whole(measures.hard_brakings)),
        ("Controls clipped", formats.counted(measures.clipped_steps, "step")),
    )


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
