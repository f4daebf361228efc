"""Tables of analyses: failure modes, their reliability, and their proof by replay."""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from eigenfail.presentation import figures, tables
from eigenfail.values.analysis import AnalysisResult, FailureMode, InfluenceShare, Moment
from eigenfail.values.arrays import Floats
from eigenfail.values.disturbance import AXES
from eigenfail.values.estimates import ChainMixing
from eigenfail.values.proof import Proof, Reproduction

NO_FAILURE = (
    "the centre of its failures is no failure. Quote its medoid, a failure that happened, or "
    "analyse with more components or other --clusters."
)
LEAST_EXPLAINED = 0.5
"""Share of the variance below which eigenfailures are far from the failures they stand for."""

LIKELIHOODS = (
    "log p: natural logarithm of the density of the noise. Log p of p(x): the mean log p of random "
    "noise under p(x) over the same steps. Noise of zeros has the largest log p."
)
TOO_FEW = "Eigenfailures of so few components may not fail again: use more with --components."


class ChannelWords(NamedTuple):
    """Words for the channels of the noise: for one, for several, and for all together."""

    one: str
    several: str
    together: str


MOST_CHANNELS = 3
"""Most channels with columns of their own in the table of modes, or with lines in a chart."""


def pick_channels(weights: Floats) -> list[int]:
    """Return the columns of the channels to show: those with the greatest total weight.

    Args:
        weights: weight of each channel at each step, not negative, shape (steps, channels): its
            influence, or the square of its noise.

    Returns:
        All columns in their order, if there are at most `MOST_CHANNELS`; otherwise the
        `MOST_CHANNELS` columns with the greatest weight.
    """
    count = weights.shape[1]
    if count <= MOST_CHANNELS:
        return list(range(count))
    return rank_channels(weights)[:MOST_CHANNELS]


def rank_channels(weights: Floats) -> list[int]:
    """Return the columns of channels in order of their summed weights, the greatest first."""
    # Stable: channels of equal weight keep their order, or the same analysis would be drawn
    # differently on another machine.
    sums = np.asarray(weights, np.float64).sum(axis=0)
    return [int(way) for way in np.argsort(-sums, kind="stable")]


def choose_channel_words(channels: Sequence[str]) -> ChannelWords:
    """Return the words for channels; the channels of position noise are called axes."""
    if tuple(channels) == AXES:
        return ChannelWords("axis", "axes", "both")
    return ChannelWords("channel", "channels", "all")


def tabulate_modes(campaign: int, result: AnalysisResult) -> tables.Table:
    """Return the failure modes of a campaign, counted from 1; disturbances in sigma.

    Modes that are not distinct are called groups. With more than `MOST_CHANNELS` channels, a row
    shows only the strongest channel of its eigenfailure.
    """
    has_probability = any(mode.probability for mode in result.modes)
    list_disturbances: Callable[[FailureMode, Sequence[str]], Iterator[tables.Cell]] = (
        _list_disturbances
    )
    disturbances = (
        *(tables.TableColumn(f"Mean {channel}", "sigma") for channel in result.channels),
        *tables.name_columns(*(f"Peak {channel}" for channel in result.channels)),
    )
    # Two columns for each of many channels would not fit a terminal: a row names its strongest.
    if len(result.channels) > MOST_CHANNELS:
        list_disturbances = _list_strongest
        disturbances = (*tables.name_columns("Strongest channel", "Peak"),)
    columns = (
        *tables.count_columns(result.cluster_noun.capitalize(), "Failures"),
        tables.TableColumn("Share", "share"),
        *disturbances,
        *tables.name_columns("Medoid"),
        *([tables.TableColumn("Probability")] if has_probability else []),
    )
    rows = tuple(
        (
            str(place),
            mode.failures,
            mode.failures / len(result.episodes),
            *list_disturbances(mode, result.channels),
            f"{mode.medoid_campaign or campaign}/{mode.medoid}",
            *([mode.probability] if has_probability else []),
        )
        for place, mode in enumerate(result.modes, start=1)
    )
    return tables.Table("Failure modes" if result.distinct else "Groups of failures", columns, rows)


def _list_strongest(mode: FailureMode, channels: Sequence[str]) -> Iterator[tables.Cell]:
    # By energy, not by peak: a single spike does not make a channel the strongest.
    strongest = int(np.argmax(np.square(mode.typical).sum(axis=0)))
    yield channels[strongest]
    yield format_peak(mode.typical[:, strongest])


def _list_disturbances(mode: FailureMode, _channels: Sequence[str]) -> Iterator[tables.Cell]:
    noises = mode.typical.T
    yield from (
        tables.FormattedCell(figures.format_signed(float(noise.mean()))) for noise in noises
    )
    yield from map(format_peak, noises)


def format_peak(noise: Floats) -> str:
    """Return the largest disturbance of one channel, and its step."""
    step = int(np.argmax(np.abs(noise)))
    return f"{figures.format_signed(float(noise[step]))} at step {step}"


def describe_modes(campaign: int, result: AnalysisResult) -> tuple[tables.Block, ...]:
    """Return the failure modes, the variance explained, and whether the modes are distinct."""
    verdict = result.diversity.verdict if result.diversity else result.verdict
    words = f"{verdict} {result.caution}".rstrip()
    return (tabulate_modes(campaign, result), describe_components(result), words)


def list_mode_words(result: AnalysisResult) -> Iterator[str]:
    """Yield a description of each mode that begins with its number.

    The stored words say "mode"; modes that are not distinct are called groups here.
    """
    noun = result.cluster_noun.capitalize()
    for place, words in enumerate(result.words, start=1):
        yield f"{noun} {place}: {words.removeprefix(f'Mode {place}: ')}"


GROUPINGS = {
    "behaviour": "the acceleration of the ego {}",
    "energy": "the energy of their noise in windows of 0.5 s",
    "noise": "the principal components of their noise",
}
SPANS = {"collision": "before the collision", "start": "from the start on"}


def describe_grouping(result: AnalysisResult) -> str:
    """Return the features that failures were grouped by, in words."""
    found = result.behaviour
    words = GROUPINGS[result.features].format(SPANS[found.origin] if found else "")
    return f"{words}, and by the vehicle that it struck" if found and found.struck else words


def describe_components(result: AnalysisResult) -> str:
    """Return the share of the variance that the components explain."""
    share, count = float(np.sum(result.explained)), len(result.explained)
    words = f"{count} components explain {figures.format_share(share)} of their variance."
    words = f"{figures.format_count(len(result.episodes))} failures; {words}"
    return words if share >= LEAST_EXPLAINED else f"{words} {TOO_FEW}"


def describe_findings(result: AnalysisResult) -> Iterator[str]:
    """Return diversity, stability and times of greatest influence, in sentences."""
    yield f"Failures are grouped by {describe_grouping(result)}."
    yield from describe_diversity(result)
    yield from result.notes
    yield from _describe_stability(result)
    for channel in result.channels:
        moments = [each for each in result.moments if each.axis == channel]
        if moments:
            times = ", ".join(map(format_moment, moments))
            yield f"{channel.capitalize()} noise differs most between failures {times}."
    yield from (describe_influence(each, result.channels) for each in result.before_collision)
    for place, mode in enumerate(result.modes, start=1):
        if mode.probability and mode.probability.problem:
            yield f"Mode {place} has no probability: {mode.probability.problem}"
    bounds = (mode.probability for mode in result.modes if mode.probability)
    # Modes share their reasons: each is given once.
    for reason in dict.fromkeys(each.note for each in bounds if each.bound):
        yield f'Probabilities with "at least" are lower bounds: {reason}'
    if result.digest:
        yield f"Digest of every number (SHA-256): {result.digest}"


def describe_diversity(result: AnalysisResult) -> Iterator[str]:
    """Yield how the failures spread over modes, and whether the modes have collapsed."""
    found = result.diversity
    if found is None:
        return
    yield (
        f"The noise of the {figures.format_count(found.failures)} failures has a standard "
        f"deviation of {figures.format_number(found.spread)} sigma about its mean; that "
        "of p(x) has 1."
    )
    # A single mode is seen from the first failure on.
    if found.modes > 1:
        seen = ", ".join(map(str, found.coverage))
        yield f"Modes among the analysed failures after each tenth of the campaign: {seen}."
    if found.collapse:
        yield f"Warning: {found.collapse}"


def _describe_stability(result: AnalysisResult) -> Iterator[str]:
    found, noun = result.stability, result.cluster_noun
    if found is not None:
        index = f"{figures.format_number(found.median)} {figures.format_interval(found.interval)}"
        yield (
            f"Drawn again {found.resamples} times, the {noun}s have an adjusted Rand index of "
            f"{index}; 1 is the same {noun}s, 0 is chance."
        )
    if result.outliers:
        yield f"{figures.format_share(result.outliers)} of the failures were near no {noun}."


def format_moment(found: Moment) -> str:
    """Return a moment, in seconds if steps have a duration."""
    if found.before_collision_s is None:
        return f"at step {found.step}"
    return f"{figures.format_number(found.before_collision_s)} s before the collision"


def describe_influence(found: InfluenceShare, channels: Sequence[str]) -> str:
    """Return the share of the influence that lies in the last seconds before the collision."""
    if found.both is None:
        return f"Failures differ in no step of the last {found.seconds:g} s or before."
    # A channel without influence would only lengthen the sentence.
    parts = zip(channels, found.by_channel, strict=True)
    apart = ", ".join(
        f"{channel} {figures.format_share(share)}" for channel, share in parts if share
    )
    return (
        f"The last {found.seconds:g} s before the collision, {figures.format_share(found.time)} of "
        f"the time, hold {figures.format_share(found.both)} of the influence ({apart})."
    )


def tabulate_moments(result: AnalysisResult) -> tables.Table:
    """Return the moments of greatest influence."""
    channel = choose_channel_words(result.channels).one.capitalize()
    note = (
        "Influence: components weighted by explained variance. It says where the noise of the "
        "failures differs, not what causes them."
    )
    columns = (*tables.name_columns(channel, "When"), tables.TableColumn("Influence"))
    rows = tuple(
        (each.axis.capitalize(), format_moment(each), each.influence) for each in result.moments
    )
    return tables.Table("Moments of greatest influence", columns, rows, (note,))


def tabulate_last_influence(result: AnalysisResult) -> tables.Table:
    """Return the share of the influence that lies in the last seconds before the collision."""
    together = choose_channel_words(result.channels).together
    titles = ("Of the time", *map(str.capitalize, (*result.channels, together)))
    columns = (
        *tables.name_columns("Time"),
        *(tables.TableColumn(title, "share") for title in titles),
    )
    rows = tuple(
        (f"Last {each.seconds:g} s", each.time, *each.by_channel, each.both)
        for each in result.before_collision
    )
    note = "The shares would equal that of the time if the failures differed alike at all moments."
    return tables.Table("Influence before the collision", columns, rows, (note,))


def tabulate_noise_within(result: AnalysisResult, step_s: float | None = None) -> tables.Table:
    """Return how the noise differs within each mode, for failures that are grouped by behaviour.

    Args:
        result: result of the analysis.
        step_s: duration of a step if failures are aligned at the collision; None if their steps
            count from the start. [s]
    """
    noun = result.cluster_noun
    columns = (
        *tables.count_columns(noun.capitalize(), "Failures"),
        tables.TableColumn("Variance explained", "share"),
        *tables.name_columns("Noise differs most"),
    )
    rows = tuple(
        (
            str(place),
            mode.failures,
            float(np.sum(mode.explained)),
            _find_difference(mode.components, mode.explained, result.channels, step_s),
        )
        for place, mode in enumerate(result.modes, start=1)
        if mode.components is not None and mode.explained is not None and len(mode.explained)
    )
    note = f"By the principal components of the noise of each {noun} alone."
    return tables.Table(f"Noise within {noun}s", columns, rows, (note,))


def _find_difference(
    components: Floats, explained: Floats, channels: Sequence[str], step_s: float | None
) -> str:
    # Weighted by what they explain: a component that explains little must not decide.
    influence = np.tensordot(explained, np.abs(components), axes=1)
    step, way = map(int, np.unravel_index(int(influence.argmax()), influence.shape))
    # Aligned failures end with the collision, one step after the last step of their noise.
    before_s = None if step_s is None else (len(influence) - step) * step_s
    moment = Moment(channels[way], step, before_s, float(influence[step, way]))
    return f"{moment.axis} {format_moment(moment)}"


def tabulate_sources(result: AnalysisResult) -> tables.Table:
    """Return the analysed campaigns, in their state at that time."""
    return tables.tabulate(
        "Analysed campaigns",
        result.sources,
        tables.read_text("Campaign", lambda each: str(each.campaign)),
        tables.read_number("Failures", "failures"),
        tables.read_number("Episodes", "episodes"),
        tables.read_text(
            "State then", lambda each: "running: a snapshot" if each.running else "ended"
        ),
    )


def describe_proof(proof: Proof, noun: str = "mode", unit: str = "m") -> tuple[tables.Block, ...]:
    """Return the replays of a proof, and how many of them failed again.

    Args:
        proof: results of the replays so far.
        noun: the analysis's noun for its clusters, see `AnalysisResult.cluster_noun`.
        unit: unit of robustness; empty for a function or requirements.
    """
    replays = tabulate_replays(proof, noun, unit)
    return (replays, *count_reproductions(proof, noun, unit))


def tabulate_replays(proof: Proof, noun: str = "mode", unit: str = "m") -> tables.Table:
    """Return the replays, one a row, with log p of each and the expected log p of noise of p(x)."""
    # log p of an episode is a large number whose differences count: three digits would hide them.
    columns = (
        *tables.name_columns("Scenario", noun.capitalize(), "Replayed", "Outcome"),
        tables.TableColumn("Robustness", unit),
        tables.TableColumn("log p", "nats", digits=5),
        tables.TableColumn("log p/step", "nats"),
        tables.TableColumn("log p of p(x)", "nats", digits=5),
        tables.TableColumn("Episode"),
    )
    rows = tuple(
        (
            scenario.words,
            str(replay.mode + 1),
            replay.what,
            replay.outcome.word if replay.outcome else None,
            replay.robustness_m,
            replay.log_probability,
            replay.log_probability_per_step,
            replay.expected_log_probability,
            f"{replay.campaign}/{replay.index}",
        )
        for scenario in proof.scenarios
        for replay in scenario.replays
    )
    return tables.Table("Replays", columns, rows, (LIKELIHOODS,))


def count_reproductions(proof: Proof, noun: str = "mode", unit: str = "m") -> Iterator[str]:
    """Yield how many of the replays failed again, in sentences."""
    yield f"{_count_failed_again(proof.reproduced, 'eigenfailures', unit)} in the same scenario."
    # Of one scenario these counts would repeat the sentence above.
    if len(proof.scenarios) > 1:
        pairs = f"({figures.count_noun(len(proof.modes), noun)}, {len(proof.scenarios)} scenarios)"
        kinds = {"eigenfailures": proof.eigenfailures, "medoids": proof.medoids}
        for kind, found in kinds.items():
            yield f"{_count_failed_again(found, f'replays of {kind}', unit)} {pairs}."
    for mode in proof.modes:
        parts = [format_reproduction(each, unit).line for each in (mode.eigenfailure, mode.medoid)]
        who = f"{noun.capitalize()} {mode.mode + 1}"
        yield f"{who}: eigenfailure {parts[0]}; medoid {parts[1]}."
        if mode.nearest:
            yield f"{who}: nearest failing point {mode.nearest.words}."
        # A centre of failures need not fail itself: the reader needs to know what to quote instead.
        elif mode.eigenfailure.rate and not mode.eigenfailure.rate.k:
            yield f"{who}: {NO_FAILURE}"


def _count_failed_again(found: Reproduction, replayed: str, unit: str) -> str:
    if found.rate is None:
        return f"None of the {replayed} was completed"
    cell = format_reproduction(found, unit)
    return cell._replace(value=f"{cell.value} {replayed} reproduced a failure").line


def format_reproduction(found: Reproduction, unit: str = "m") -> tables.FormattedCell:
    """Return how many replays failed again, and the smallest robustness if none did.

    Args:
        found: count of the replays.
        unit: unit of robustness; empty for a function.
    """
    if found.rate is None:
        return tables.FormattedCell(figures.UNKNOWN, sample="no replay completed")
    # A failure has no distance left: its robustness is 0.
    sample = ""
    if not found.rate.k and found.smallest_robustness_m is not None:
        nearest = figures.format_quantity(found.smallest_robustness_m, unit)
        sample = f"smallest robustness {nearest}".rstrip()
    return tables.FormattedCell(f"{found.rate.k} of {found.rate.n}", sample=sample)


def describe_chain_mixing(found: ChainMixing) -> tuple[tables.Block, ...]:
    """Return the verdict on the chains of a campaign, and its reasons by projection."""
    share = figures.format_share(found.accepted / found.moves if found.moves else None)
    others = "" if found.started == found.chains else " The others began where these did."
    accepted = f"{figures.format_count(found.accepted)} of {figures.format_count(found.moves)}"
    first = f"{found.campaign}/{found.first_sample}"
    sentences = (
        f"Chains: the starts of {found.started} of {found.chains} failed.{others}",
        f"Samples: {accepted} moves after burn-in failed ({share}), from episode {first} on.",
        found.verdict,
        found.remark,
    )
    if not found.projections:
        return sentences
    readings = (
        tables.read_text("Projection", "name"),
        tables.read_number("R-hat", "r_hat"),
        tables.read_number("Effective samples", "effective"),
    )
    table = tables.tabulate("Mixing", found.projections, *readings)
    return (*sentences, table)
