"""An analysis: the failures of one or several campaigns, grouped into modes."""

import re
from collections.abc import Iterator, Mapping, Sequence
from enum import StrEnum
from typing import Annotated, Any, Literal

import msgspec
import numpy as np

from eigenfail.settings import Ordinal
from eigenfail.values.arrays import Floats
from eigenfail.values.disturbance import AXES
from eigenfail.values.estimates import Estimate, Interval
from eigenfail.values.showing import Brief, Shown
from eigenfail.values.triage import TriageState

COLLAPSED_SHARE = 0.9
"""If one mode holds a larger share of the failures, the modes have collapsed."""


NARROW_SPREAD = 0.5
"""If failures of one mode differ less than this, the modes have collapsed, too. [sigma]"""


class Diversity(msgspec.Struct, frozen=True, kw_only=True):
    """How the failures of a campaign spread over modes.

    If clusters cannot be distinguished from clusters of noise, all failures count as one mode.

    Attributes:
        failures: number of failures analysed.
        modes: number of clusters that are distinguishable from clusters of noise; at least 1.
        largest_share: share of the failures in the largest mode.
        effective_modes: exp of the Shannon entropy of the shares (Hill 1973): 1 if one mode holds
            all failures, `modes` if all modes hold equally many.
        spread: how much the failures differ: root mean square over steps and channels of the
            standard deviation of z between failures; 1 for noise of p(x), None for a single
            failure. [sigma]
        coverage: number of modes seen after each tenth of the campaign's episodes.
        verdict: summary in one sentence.
        warning: warning that the modes have collapsed, and what to try; empty otherwise. Digests
            cover its words; `collapse` has the same content in sentences.
    """

    failures: int
    modes: int
    largest_share: float
    effective_modes: float
    spread: float | None
    coverage: tuple[int, ...]
    verdict: str
    warning: str = ""

    @property
    def collapse(self) -> str:
        """The warning that pages, reports and terminals show, in sentences; empty without one."""
        if not self.warning:
            return ""
        found = f"the failures differ by {self.spread or 0.0:.2f} sigma only"
        if self.modes > 1:
            found = f"{100.0 * self.largest_share:.0f} % of the failures are of one mode"
        return f"Mode collapse: {found}. {_AGAINST_COLLAPSE}"


_AGAINST_COLLAPSE = (
    "Try the method ensemble, the reward dissimilarity, or a distribution of scenarios."
)


STABLE = 0.8
"""Adjusted Rand index below which clusters are not called modes: above it a partition is recovered
well, below 0.65 poorly (Steinley 2004, Psychological Methods 9, 386–396)."""


FEWEST_OF_MODE = 3
"""Modes of fewer failures are named as small. A draw of all failures with replacement holds none of
a mode of m failures with probability e^-m: 37 % for one failure, 14 % for two, 5 % for three. The
bootstrap therefore says little of whether a smaller mode would come back."""


class AnalysedCampaign(msgspec.Struct, frozen=True, kw_only=True):
    """State of a campaign when its failures were analysed.

    Attributes:
        episodes: number of episodes that had ended, failures or not.
        failures: number of failures that were analysed.
        running: whether more episodes were to come, so that the analysis is of a snapshot.
    """

    campaign: int
    episodes: int
    failures: int
    running: bool = False


class Stability(msgspec.Struct, frozen=True):
    """Bootstrap stability: whether clusters come back if failures are drawn with replacement.

    Attributes:
        resamples: number of draws.
        rows: number of failures in each draw.
        median: median of the adjusted Rand index (Hubert and Arabie 1985) between the clusters and
            the clusters of a draw: 1 if they are the same, 0 as by chance.
        interval: interval from the 2.5 % to the 97.5 % quantile of the index over the draws.
    """

    resamples: int
    rows: int
    median: float
    interval: Interval


class Moment(msgspec.Struct, frozen=True):
    """A step at which noise matters most.

    Attributes:
        axis: the channel, such as "longitudinal" or "lateral".
        step: row of `influence`, in the alignment of the analysis.
        before_collision_s: time from the step to the collision; if failures are aligned at the
            start, to the collision of the median failure. None if the duration of a step is
            undefined. [s]
        influence: influence of this step, as in `influence`.
    """

    axis: str
    step: int
    before_collision_s: float | None
    influence: float


class InfluenceShare(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """How much of the influence lies in the last seconds before the collision.

    The failures are aligned at the collision, whatever the analysis uses, and the whole time is the
    time that half of them last. If no time mattered more than another, all shares would be equal.

    Attributes:
        seconds: length of the interval that ends at the collision. [s]
        time: share of the whole time in the interval.
        longitudinal: share of the longitudinal influence in the interval; None if there is none.
        lateral: share of the lateral influence; None if there is none.
        both: share of the influence of all channels; None if there is none.
        channels: share of the influence of each channel of the analysis, in their order; empty if
            the channels are the longitudinal and the lateral one, which have their own fields.
    """

    seconds: float
    time: float
    longitudinal: float | None
    lateral: float | None
    both: float | None
    channels: tuple[float | None, ...] = ()

    @property
    def by_channel(self) -> tuple[float | None, ...]:
        """The share of the influence of each channel, whichever channels there are."""
        return self.channels or (self.longitudinal, self.lateral)


class TrainingInterval(msgspec.Struct, frozen=True, eq=False, kw_only=True):
    """The failures of a tenth of each campaign's episodes.

    Attributes:
        start: beginning of the interval, as a share of the episodes.
        end: end of the interval, as a share of the episodes.
        failures: number of failures in the interval.
        mean: mean of z over these failures, shape (steps, channels); zeros without a failure.
            [sigma]
        components: components of the interval's failures alone, shape (at most 3, steps, channels).
            The sign of each agrees with the component of the same number over all failures.
        explained: share of the variance of the interval's failures that each component explains.
        likeness: |cosine| between each component and the one with its number over all failures.
    """

    start: float
    end: float
    failures: int
    mean: Floats
    components: Floats
    explained: Floats
    likeness: Floats


JOINT = "joint"
"""The choice of `axes` that analyses all channels together."""


LONGEST_CHANNEL = 32
"""Maximum length of the name of a channel [characters]."""


MAX_CLUSTERS = 50


MAX_CAMPAIGNS = 50


MAX_RESAMPLES = 1000


Centre = Literal["median", "mean"]


Alignment = Literal["start", "collision"]


Clusterer = Literal["kmeans", "hdbscan", "gaussian_mixture"]


FailureChoice = Literal["latest", "all"]


Features = Literal["behaviour", "noise"]


Grouping = Literal["behaviour", "energy", "noise"]


class AnalysisSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How failures are analysed; docs/analysis.md explains the choices.

    Attributes:
        align: put the trajectories side by side at their first step or at their collision.
        components: k of the PCA.
        clusters: number of failure modes; None chooses 2 to 8 by silhouette. `hdbscan` finds the
            number itself: give none.
        axes: channels of the noise to analyse: `joint` for all together, the name of a channel, or
            a name such as `every.lateral` for that quantity of all vehicles.
        clusterer: clustering algorithm.
        campaigns: further campaigns, whose failures are analysed with the first one's.
        bootstrap: how often the failures are drawn again to see whether the modes come back; 0
            for no bootstrap.
        failures: failures to analyse. `latest`: if the method learnt while it ran, the latest half
            of a campaign's failures. The earlier half comes from proposals that the method has
            given up: with it, the modes would be stages of the learning. For other methods, and
            for methods that estimate the probability of each mode, all failures. `all`: all
            failures.
        centre: centre of a mode that its eigenfailure shows. `median`: the median of the noise of
            its failures at each step. `mean`: the mean of its failures in PCA space, taken back to
            noise, as in the paper.
        features: what failures are grouped by. `behaviour`: the acceleration of the ego in the last
            seconds before the collision, and the vehicle that it struck if the failures differ in
            it. If that is not stored for all failures: the energy of the noise in windows of
            0.5 s. If the duration of a step is undefined: the noise. `AnalysisResult.features`
            shows which features were used. `noise`: the principal components of the noise, as in
            the paper.
    """

    align: Alignment = "start"
    components: Annotated[int, msgspec.Meta(ge=1, le=MAX_CLUSTERS)] = 3
    clusters: Annotated[int, msgspec.Meta(ge=1, le=MAX_CLUSTERS)] | None = None
    axes: Annotated[str, msgspec.Meta(min_length=1, max_length=LONGEST_CHANNEL)] = JOINT
    clusterer: Clusterer = "kmeans"
    campaigns: Annotated[tuple[Ordinal, ...], msgspec.Meta(max_length=MAX_CAMPAIGNS)] = ()
    bootstrap: Annotated[int, msgspec.Meta(ge=0, le=MAX_RESAMPLES)] = 20
    failures: FailureChoice = "latest"
    centre: Centre = "median"
    features: Features = "behaviour"


class AnalysisState(StrEnum):
    """State of an analysis."""

    QUEUED = "queued"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"


class FailureMode(Brief, Shown, msgspec.Struct, frozen=True, eq=False):
    """A cluster of failures.

    Attributes:
        failures: number of failures in the mode.
        medoid: index of the real episode nearest to the centre, by the features that failures are
            grouped by.
        centre: mean of its failures in the PCA space of the noise, shape (components,).
        eigenfailure: the centre of its noise by `AnalysisSettings.centre`: z, shape (steps,
            channels), aligned at the start and ready to be injected. In a channel that was left
            out: the median or mean of its failures. [sigma]
        medoid_campaign: the campaign of the medoid; None: the one that was analysed.
        probability: probability of a failure of this mode under p(x), if the campaign's method
            estimates it; None otherwise.
        band: band from the 10 % to the 90 % quantile of z at each step, over its failures that
            lasted so long, shape (2, steps, channels), aligned as `eigenfailure`. [sigma]
        components: principal components of the noise of its failures alone, shape (at most as many
            as the analysis has, steps, channels), aligned as in the analysis; None if failures
            were grouped by their noise.
        explained: share of the variance of its failures' noise that each component explains.
        number: its number in the analysis, from 1, as pages and commands show it; 0 if the mode
            does not belong to a result.
        drawn: scenario parameters that its medoid drew, by name; none if none vary.
        lasting: number of steps that at least half of its failures lasted; 0 if unknown.
    """

    failures: int
    medoid: int
    centre: Floats
    eigenfailure: Floats
    medoid_campaign: int | None = None
    probability: Estimate | None = None
    band: Floats | None = None
    components: Floats | None = None
    explained: Floats | None = None
    number: int = 0
    drawn: Mapping[str, Any] = {}
    lasting: int = 0

    @property
    def typical(self) -> Floats:
        """The steps of the eigenfailure that at least half of the failures reach. [sigma]

        Fewer than half of the failures have later steps.
        """
        return self.eigenfailure[: self.lasting or None]


LONGEST_MODE_NAME = 80
"""Maximum length of the name of a mode [characters]."""


class Mode(Shown, msgspec.Struct, frozen=True):
    """A failure mode of an analysis, by number and name.

    Attributes:
        analysis: id of the analysis.
        number: its number in the analysis, from 1.
        failures: number of failures in the mode.
        name: the name that a user gave it; until then, the beginning of its description.
        state: state of its triage.
    """

    analysis: int
    number: int
    failures: int
    name: str
    state: TriageState = TriageState.NEW


class ModeBehaviour(Brief, msgspec.Struct, frozen=True, eq=False):
    """The behaviour of the ego in the failures of a mode.

    Attributes:
        mean: mean acceleration of the ego at each step over the failures of the mode, shape
            (steps,). [m/s²]
        members: acceleration of the ego in some failures of the mode, evenly spread over them,
            shape (at most 20, steps). [m/s²]
        words: description of the behaviour in a sentence.
    """

    mean: Floats
    members: Floats
    words: str


class Behaviour(Brief, msgspec.Struct, frozen=True, eq=False):
    """Behaviour of the ego, which failures were grouped by.

    Attributes:
        origin: zero of the times: the `collision`, or the `start` if failures need not end in a
            collision.
        times_s: time at the end of each step, up to 0 at the collision, shape (steps,). [s]
        explained: share of the variance of the acceleration, and of the vehicles in `struck`, that
            each principal component explains.
        scores: failures in the space of the components, shape (failures, components). [m/s²]
        modes: the behaviour in each mode, in the order of the modes.
        struck: number of the vehicle that the ego struck in each failure, in the order of the rows,
            if failures were also grouped by it; empty otherwise.
    """

    origin: Literal["collision", "start"]
    times_s: Floats
    explained: Floats
    scores: Floats
    modes: tuple[ModeBehaviour, ...]
    struck: tuple[int, ...] = ()


_PHRASE_ENDS = re.compile(r"; |, (?![^()]*\))|\. | (?=(?:from|during) \d)")
"""Where a description may end: between phrases, but not inside parentheses."""


_NUMBERED = re.compile(r"(?:Mode |.* \(mode )(\d+)\)?", re.DOTALL)
"""Names that end with the number of a mode, as proposed names may."""


def propose_mode_names(words: Sequence[str]) -> tuple[str, ...]:
    """Return a unique name for each mode of an analysis, made from its description.

    A name is the beginning of the first sentence of the description, up to the end of a phrase.
    If another mode has the same name, the name is the longest beginning of the whole description
    that fits, with the number of the mode in parentheses. If none fits, the name is "Mode 3".

    Args:
        words: the descriptions in the order of the modes; an empty one gives "Mode 3" or the like.
    """
    plain = [text.removeprefix(f"Mode {n}: ") for n, text in enumerate(words, start=1)]
    firsts = [_find_phrases(text.split(". ")[0].removesuffix(".")) for text in plain]
    wholes = [_find_phrases(text.removesuffix(".")) for text in plain]
    longest = [phrases[-1] if phrases else "" for phrases in firsts]
    return tuple(
        _tell_apart(number, name, longest, whole) if name else f"Mode {number}"
        for number, (name, whole) in enumerate(zip(longest, wholes, strict=True), start=1)
    )


def _find_phrases(text: str) -> list[str]:
    """Return the beginnings of a text that end with a phrase and fit a name, shortest first."""
    ends = [found.start() for found in _PHRASE_ENDS.finditer(text)] + [len(text)]
    return [text[:end] for end in ends if 0 < end <= LONGEST_MODE_NAME]


def _tell_apart(number: int, name: str, names: Sequence[str], beginnings: Sequence[str]) -> str:
    """Return a name that no other mode has, with more of the description and a number if needed.

    A name that ends with the number of another mode is replaced: that mode may have this name.
    """
    others = [each for place, each in enumerate(names, start=1) if place != number]
    numbered = _NUMBERED.fullmatch(name)
    if name not in others and (numbered is None or int(numbered[1]) == number):
        return name
    suffix = f" (mode {number})"
    fitting = [each for each in beginnings if len(each) + len(suffix) <= LONGEST_MODE_NAME]
    return f"{fitting[-1]}{suffix}" if fitting else f"Mode {number}"


class AnalysisResult(Brief, msgspec.Struct, frozen=True, eq=False):
    """The findings of PCA and clustering.

    Attributes:
        episodes: index of the episode in each row of the data.
        explained: share of the variance that each component explains, shape (components,).
        components: shape (components, steps, channels); signs are chosen so that the largest
            entry is positive; zero in a channel that was left out.
        scores: the data in PCA space D* = (D - mu) V_k, shape (failures, components).
        labels: the mode of each failure, by position in `modes`, from 0; pages, tables and data
            frames number modes from 1.
        silhouette: silhouette of the clustering, from -1 to 1; None with a single mode.
        noise_silhouette: the largest silhouette that the same clustering reaches on 19 draws of
            data without groups, with the same covariance and the same distances from the centre.
        influence: how much each step matters, shape (steps, channels): component magnitudes
            weighted by explained variance.
        diversity: how the failures spread over modes.
        campaigns: the campaign of each row; empty: the one that was analysed.
        stability: stability of the clusters; None with a single mode, or without bootstrap.
        outliers: share of the failures that the clusterer left out, before they joined the mode of
            their nearest neighbour; 0 except for `hdbscan`.
        moments: the steps of greatest influence of each channel, the greatest first.
        before_collision: how much influence lies in the last seconds before the collision.
        training: ten intervals of the episodes, in order.
        sources: state of the campaigns when they were analysed.
        words: description of each mode, in the order of the modes.
        notes: remarks on the pooled failures.
        digest: SHA-256 of the result except words, bands, behaviour and names of channels;
            repeated analyses have the same digest.
        channels: names of the components of the noise at each step, in order.
        features: what the failures were grouped by. Components, scores and influence always
            describe the noise.
        behaviour: behaviour of the ego; None unless the failures were grouped by it.
    """

    episodes: tuple[int, ...]
    explained: Floats
    components: Floats
    scores: Floats
    labels: tuple[int, ...]
    modes: tuple[FailureMode, ...]
    influence: Floats
    silhouette: float | None
    noise_silhouette: float | None
    diversity: Diversity | None = None
    campaigns: tuple[int, ...] = ()
    stability: Stability | None = None
    outliers: float = 0.0
    moments: tuple[Moment, ...] = ()
    before_collision: tuple[InfluenceShare, ...] = ()
    training: tuple[TrainingInterval, ...] = ()
    sources: tuple[AnalysedCampaign, ...] = ()
    words: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    digest: str = ""
    channels: tuple[str, ...] = AXES
    features: Grouping = "noise"
    behaviour: Behaviour | None = None

    def __post_init__(self) -> None:
        # A mode is made before its place is known, and its number is its place.
        numbered = (
            mode if mode.number == number else msgspec.structs.replace(mode, number=number)
            for number, mode in enumerate(self.modes, start=1)
        )
        msgspec.structs.force_setattr(self, "modes", tuple(numbered))

    def list_modes(self, analysis: int) -> Iterator[Mode]:
        """Yield the modes of the analysis with this id, under their proposed names."""
        names = propose_mode_names(self.words or [""] * len(self.modes))
        for number, (mode, name) in enumerate(zip(self.modes, names, strict=True), start=1):
            yield Mode(analysis, number, mode.failures, name)

    def list_members(self, campaign: int) -> Iterator[tuple[int, int, int]]:
        """Yield campaign, index and number of the mode of each failure.

        Args:
            campaign: the campaign that was analysed.
        """
        owners = self.campaigns or (campaign,) * len(self.episodes)
        for owner, index, label in zip(owners, self.episodes, self.labels, strict=True):
            yield owner, index, label + 1

    @property
    def cumulative(self) -> Floats:
        """Share of the variance that each component and the earlier ones explain together."""
        return np.cumsum(self.explained, dtype=np.float32)

    @property
    def distinct(self) -> bool:
        """True if the modes are distinguishable from noise, and stable."""
        return self.above_noise and self.stable

    @property
    def above_noise(self) -> bool:
        """True if the silhouette exceeds every silhouette found in data without groups."""
        return (
            self.silhouette is not None
            and self.noise_silhouette is not None
            and self.silhouette > self.noise_silhouette
        )

    @property
    def stable(self) -> bool:
        """True if the modes come back under the bootstrap, or it was not run."""
        return self.stability is None or self.stability.median >= STABLE

    @property
    def caution(self) -> str:
        """Doubts about distinct modes in spite of the verdict, in sentences; empty without any.

        Also empty if the verdict says that the modes are not distinct.
        """
        if not self.distinct:
            return ""
        return " ".join(filter(None, (self._describe_small_modes(), self._describe_low_index())))

    def _describe_small_modes(self) -> str:
        small = {
            number: mode.failures
            for number, mode in enumerate(self.modes, start=1)
            if mode.failures < FEWEST_OF_MODE
        }
        named = ", ".join(
            f"mode {number} has {'a single failure' if count == 1 else f'{count} failures'}"
            for number, count in small.items()
        )
        if not named:
            return ""
        return f"{named[0].upper()}{named[1:]}: fewer than {FEWEST_OF_MODE} do not show a mode."

    def _describe_low_index(self) -> str:
        if self.stability is None or self.stability.interval.low >= STABLE:
            return ""
        return (
            f"The interval of the index begins at {self.stability.interval.low:.2f}, below "
            f"{STABLE}: some draws of the failures fall into other groups."
        )

    @property
    def cluster_noun(self) -> str:
        """The word for a cluster: "mode", or "group" if the modes are not distinct."""
        return "mode" if self.distinct else "group"

    @property
    def verdict(self) -> str:
        """The verdict on distinct modes, with its reason, in a sentence."""
        if self.silhouette is None or self.noise_silhouette is None:
            return "No distinct modes: the failures make a single group."
        against = f"silhouette {self.silhouette:.2f}, on data without groups "
        against += f"{self.noise_silhouette:.2f}"
        if not self.above_noise:
            return f"No distinct modes: clusters cannot be distinguished from noise ({against})."
        if self.stability is None:
            return f"{self._count_distinct()} ({against})."
        again = f"under the bootstrap the adjusted Rand index is {self.stability.median:.2f}"
        if not self.stable:
            return f"No distinct modes: {again}, below {STABLE} ({against})."
        return f"{self._count_distinct()} ({against}; {again})."

    def _count_distinct(self) -> str:
        """Return in words how many modes are distinct, and how many have too few failures."""
        few = sum(mode.failures < FEWEST_OF_MODE for mode in self.modes)
        shown = len(self.modes) - few
        words = "1 distinct mode" if shown == 1 else f"{shown} distinct modes"
        return f"{words}, {few} more with too few failures" if few else words


class Analysis(Brief, Shown, msgspec.Struct, frozen=True, eq=False):
    """Current state of an analysis.

    Attributes:
        problem: why the analysis failed, with the remedy; empty otherwise.
    """

    id: int
    campaign: int
    settings: AnalysisSettings
    state: AnalysisState
    created_ms: int
    result: AnalysisResult | None = None
    problem: str = ""


class MinimalFailure(msgspec.Struct, frozen=True, kw_only=True):
    """A failure, as far as a campaign of the method `minimal` has shrunk it.

    Attributes:
        campaign: the campaign that shrank the failure; with `index`, the episode whose noise is
            described.
        done: whether the search is complete: without one step of one channel, or with weaker noise,
            the episode would not fail.
        because: reason for the state of the search, in words.
        words: description of the noise, in words.
        needed: number of pairs of a step and a channel that still hold noise; `injected` at first.
        energy: sum of z² over these pairs; `full_energy` at first. [sigma²]
        log_probability: log-probability of the shrunk failure, summed over its steps; of the
            failure at full strength: `full_log_probability`.
        log_probability_per_step: log-probability per step of the shrunk failure;
            `full_log_probability_per_step` likewise.
    """

    campaign: int
    index: int
    done: bool
    because: str
    words: str
    needed: int
    injected: int
    energy: float
    full_energy: float
    log_probability: float
    full_log_probability: float
    log_probability_per_step: float
    full_log_probability_per_step: float
