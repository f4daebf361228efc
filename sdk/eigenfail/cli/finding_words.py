"""What an analysis found besides its modes, in sentences."""

from collections.abc import Iterator

from eigenfail.cli.figures import number
from eigenfail.values import AXES, AnalysisResult, InfluenceShare, Moment


def finding_words(result: AnalysisResult) -> Iterator[str]:
    """All of it, as far as it was found."""
    yield from result.notes
    yield from stability_words(result)
    for axis in AXES:
        yield from moment_words(axis, [each for each in result.moments if each.axis == axis])
    yield from map(share_words, result.before_collision)
    for number_of_mode, mode in enumerate(result.modes, start=1):
        if mode.probability and mode.probability.problem:
            yield f"Mode {number_of_mode} has no probability: {mode.probability.problem}"
    if result.digest:
        yield f"Digest of every number (SHA-256): {result.digest}"


def stability_words(result: AnalysisResult) -> Iterator[str]:
    """Whether the modes come back, and how many failures belonged to none."""
    found = result.stability
    if found is not None:
        low, high = number(found.interval.low), number(found.interval.high)
        yield (
            f"Drawn again {found.resamples} times, the modes have an adjusted Rand index of "
            f"{number(found.median)} [{low}, {high}]; 1 is the same modes, 0 is chance."
        )
    if result.outliers:
        yield f"{100.0 * result.outliers:.0f} % of the failures were near no mode."


def moment_words(axis: str, moments: list[Moment]) -> Iterator[str]:
    """When noise along an axis matters most."""
    if moments:
        times = ", ".join(map(moment, moments))
        yield f"{axis.capitalize()} noise matters most {times}."


def moment(found: Moment) -> str:
    """A moment, in seconds if steps have a duration."""
    if found.before_collision_s is None:
        return f"at step {found.step}"
    return f"{number(found.before_collision_s, 1)} s before the collision"


def share_words(found: InfluenceShare) -> str:
    """How much of the influence the last seconds have."""
    if found.both is None:
        return f"No step of the last {found.seconds:g} s or before has any influence."
    parts = {"longitudinal": found.longitudinal, "lateral": found.lateral}
    apart = ", ".join(f"{axis} {percent(share)}" for axis, share in parts.items() if share)
    return (
        f"The last {found.seconds:g} s before the collision, {percent(found.time)} of the time, "
        f"hold {percent(found.both)} of the influence ({apart})."
    )


def percent(share: float) -> str:
    """Without decimals."""
    return f"{100.0 * share:.0f} %"
