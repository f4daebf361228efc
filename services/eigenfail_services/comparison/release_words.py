"""Sentences of releases: why a failure mode has its status, and what limits the comparison."""

from collections.abc import Iterable, Iterator, Mapping, Sequence

from eigenfail.presentation.figures import format_number, format_upper_bound, round_up
from eigenfail.presentation.rates import format_rate
from eigenfail.values.release import ModeSighting, ModeStatus, ReleaseMode
from eigenfail.values.triage import TriageState
from eigenfail_services.analysis.mode_matching import LEVEL, Sighting
from eigenfail_services.comparison.release_reading import ReadRelease

DIGITS = 2
"""Significant digits of a probability."""

NO_PROOF = "Not met in this search; this is no proof: replay its failures."

CHOSEN = "A search chose the episodes, so that this is no proof."

SEARCH = (
    "A search chooses its episodes: that it does not find a mode does not prove that the mode is "
    "gone. Replay the failures of the mode with the new version."
)


def describe_sighting(read: ReadRelease, found: Sighting, compared: Sequence[ReadRelease]) -> str:
    """Return why the status of a mode is what it is; empty before the mode was found.

    Args:
        read: the release.
        found: what became of the mode in it.
        compared: all releases that are compared, as `Sighting.same_as` counts them.
    """
    if found.status is None:
        return ""
    counted = _count(read, found.failures)
    if found.same_as is not None:
        earlier = compared[found.same_as].release.version
        return f"{counted}; the same code and settings as {earlier}."
    if found.status is ModeStatus.NOT_MET:
        return f"{counted}. {NO_PROOF}"
    if not read.release.is_random:
        return f"{counted}. {CHOSEN}" if found.status is ModeStatus.UNDECIDED else f"{counted}."
    return f"{counted}{_describe_test(found.chance)}"


def _count(read: ReadRelease, failures: int) -> str:
    """Return the number of failures, with its rate where the episodes are a random sample."""
    release = read.release
    if not release.failures:
        return f"No failure in {release.episodes:,} episodes" + _bound_rate(read)
    if release.analysed < release.failures:
        analysed = f"{failures:,} of the {release.analysed:,} failures analysed"
        return f"{analysed}; {release.failures:,} were found"
    if not release.is_random:
        return f"{failures:,} of the {release.failures:,} failures"
    if not failures:
        return f"0 of {release.episodes:,} episodes{_bound_rate(read)}"
    rate = read.make_rate(failures)
    return f"{failures:,} of {release.episodes:,} episodes: {format_rate(rate)}"


def _bound_rate(read: ReadRelease) -> str:
    """Return the upper bound of a rate of which no event is known."""
    if not read.release.episodes:
        return ""
    interval = read.make_rate(0).interval
    return f": {format_upper_bound(interval.high)}" if interval else ""


def _describe_test(chance: float | None) -> str:
    """Return the end of a sentence: what a test of the numbers of failures found."""
    if chance is None:
        return "."
    bound = format_number(min(1.0, round_up(chance, DIGITS)), DIGITS)
    test = (
        "if its rate were unchanged, a count this uneven would have a probability of at most "
        f"{bound}."
    )
    if chance <= LEVEL:
        return f"; {test}"
    return "; chance may explain it." if chance >= 1.0 else f"; chance may explain it: {test}"


def list_notes(read: Sequence[ReadRelease]) -> Iterator[str]:
    """Yield what limits the comparison of releases, in sentences."""
    for place, each in enumerate(read):
        release = each.release
        if release.problem:
            yield f"The failure modes of {release.version} are not compared. {release.problem}"
        if len(release.fingerprints) > 1:
            yield _describe_codes(each)
        yield from _compare_builds(each, read[:place])
        for analysis in each.groups:
            yield (
                f"{release.version}: the groups of analysis {analysis} cannot be told from chance; "
                "read them as a summary."
            )
    if any(not each.release.is_random for each in read):
        yield SEARCH


def _compare_builds(read: ReadRelease, earlier: Sequence[ReadRelease]) -> Iterator[str]:
    """Yield which earlier release has the same code, and which settings differ."""
    if not earlier:
        return
    version = read.release.version
    with_code = [each for each in earlier if each.code and each.code == read.code]
    with_build = [each for each in with_code if each.build and each.build == read.build]
    other = (with_build or with_code or [*earlier])[-1]
    differing = _list_other_settings(read, other)
    if with_build:
        yield f"{version} has the same code and settings as {other.release.version}."
    elif with_code and differing:
        yield f"{version} has the code of {other.release.version} and other settings: {differing}."
    elif with_code:
        yield f"{version} has the same code as {other.release.version}."
    elif differing:
        yield f"{version} has other settings than {other.release.version}: {differing}."


def _list_other_settings(read: ReadRelease, other: ReadRelease) -> str:
    """Return the settings of the planner that differ between two releases; empty if none does."""
    now, before = (_join_settings(each.settings.values()) for each in (read, other))
    differing = (
        f"{name} {now.get(name, 'unset')} instead of {before.get(name, 'unset')}"
        for name in sorted(now.keys() | before.keys())
        if now.get(name) != before.get(name)
    )
    return ", ".join(differing)


def _join_settings(campaigns: Iterable[Mapping[str, str]]) -> dict[str, str]:
    """Return the values of each setting over the campaigns of a release."""
    found: dict[str, dict[str, None]] = {}
    for settings in campaigns:
        for name, value in settings.items():
            found.setdefault(name, {})[value] = None
    return {name: " and ".join(sorted(values)) for name, values in found.items()}


def _describe_codes(read: ReadRelease) -> str:
    """Return in which packages the campaigns of one version had different code."""
    packages = sorted({name for code in read.release.fingerprints for name in code})
    differing = [
        f"{package} " + ", ".join(f"{digest} ({ids})" for digest, ids in by_digest.items())
        for package in packages
        if len(by_digest := _group_campaigns(read, package)) > 1
    ]
    return f"Version {read.release.version} ran with different code: {'; '.join(differing)}."


def _group_campaigns(read: ReadRelease, package: str) -> dict[str, str]:
    found: dict[str, list[int]] = {}
    for campaign, codes in read.codes.items():
        for digest in dict.fromkeys(code.get(package, "none") for code in codes):
            found.setdefault(digest, []).append(campaign)
    return {
        digest: f"campaign{'s' * (len(ids) > 1)} {', '.join(map(str, ids))}"
        for digest, ids in found.items()
    }


def describe_fixed(mode: ReleaseMode, fixed: ModeSighting) -> Iterator[str]:
    """Yield that the newest version compared has failures of a mode that is marked fixed.

    Args:
        mode: the mode.
        fixed: what became of it in the version whose mode is marked so.
    """
    compared = [each for each in mode.sightings if each.status is not None]
    if compared[-1].failures:
        yield (
            f"Mode {mode.number}, {mode.name}, is marked {TriageState.FIXED.words} (analysis "
            f"{fixed.analysis}, mode {fixed.mode}), and {compared[-1].version} has failures of it."
        )
