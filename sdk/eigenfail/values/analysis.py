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
"""A larger share of the failures in one mode is called mode collapse."""


NARROW_SPREAD = 0.5
"""Failures of one mode that differ less than this are called mode collapse, too. [sigma]"""


class Diversity(msgspec.Struct, frozen=True, kw_only=True):
    """How the failures of a campaign spread over modes.

    If clusters cannot be distinguished from those of noise, all failures count as one mode.

    Attributes:
        failures: how many it rests on.
        modes: clusters that are more than what clustering finds in noise; at least 1.
        largest_share: share of the failures that is in the largest mode.
        effective_modes: exp of the Shannon entropy of the shares (Hill 1973): 1 if all are in
            one mode, `modes` where all modes hold equally many.
        spread: how much the failures differ: root mean square over steps and channels of the
            standard deviation of z between failures; 1 for noise of p(x), None of a single failure.
            [sigma]
        coverage: how many of the modes had been seen after each tenth of the campaign's episodes.
        verdict: summary in one sentence.
        warning: warning that the modes have collapsed, and what to try; empty otherwise. Digests of
            results rest on its words; `collapse` says the same in sentences.
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
        """The warning in sentences that pages, reports and terminals show; empty without one."""
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
    """A campaign as it stood when its failures were analysed.

    Attributes:
        episodes: how many had ended, failures or not.
        failures: how many of them were analysed.
        running: whether more were to come: the analysis is of a snapshot then.
    """

    campaign: int
    episodes: int
    failures: int
    running: bool = False


class Stability(msgspec.Struct, frozen=True):
    """Whether the clusters come back when the failures are drawn again, with replacement.

    Attributes:
        resamples: how often they were drawn.
        rows: how many failures each draw has.
        median: median of the adjusted Rand index (Hubert and Arabie 1985) between the clusters and
            those of a draw: 1 if they are the same, 0 as by chance.
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
        before_collision_s: time from the step to the collision; with alignment at the start to
            that of the median failure. None if steps have no duration. [s]
        influence: influence of this step, as in `influence`.
    """

    axis: str
    step: int
    before_collision_s: float | None
    influence: float


class InfluenceShare(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """How much of the influence lies in the last time before the collision.

    Always of failures aligned at the collision, and over the time that half of them last: the
    shares would be equal if no time mattered more than another.

    Attributes:
        seconds: how long before the collision the time begins. [s]
        time: its share of the time.
        longitudinal: its share of the longitudinal influence; None if there is none.
        lateral: the same of the lateral influence.
        both: its share of all of it.
        channels: its share of the influence of each of the analysis's channels, in their order;
            empty if they are the longitudinal and the lateral one, which have their own fields.
    """

    seconds: float
    time: float
    longitudinal: float | None
    lateral: float | None
    both: float | None
    channels: tuple[float | None, ...] = ()

    @property
    def by_channel(self) -> tuple[float | None, ...]:
        """Its share of the influence of each channel, whichever they are."""
        return self.channels or (self.longitudinal, self.lateral)


class TrainingInterval(msgspec.Struct, frozen=True, eq=False, kw_only=True):
    """The failures of a tenth of each campaign's episodes.

    Attributes:
        start: where the interval begins, as a share of the episodes.
        end: where it ends.
        failures: how many there are in it.
        mean: mean of z over these failures, shape (steps, channels); zeros without a failure.
            [sigma]
        components: components of these failures alone, each turned towards the component of the
            same number of all failures, shape (at most 3, steps, channels).
        explained: share of their variance that each explains.
        likeness: |cosine| between each and the one of the same number of all failures.
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
    """How failures are analysed; docs/analysis.md says when to use what.

    Attributes:
        align: put the trajectories side by side at their first step or at their collision.
        components: k of the PCA.
        clusters: number of failure modes; None chooses 2 to 8 by silhouette. `hdbscan` finds the
            number itself and takes none.
        axes: channels of the noise that is analysed: `joint`, all together, the name of one, or a
            name such as `every.lateral` for that quantity of all vehicles.
        clusterer: clustering algorithm.
        campaigns: further ones, whose failures are analysed with those of the first.
        bootstrap: how often the failures are drawn again to see whether the modes come back; 0
            leaves it out.
        failures: failures that are analysed. `latest`: where a method learnt while it ran, the
            latest half of a campaign's failures; those before come from proposals that it has given
            up, and mixed with them the modes are stages of the learning. All failures of other
            methods, and of those that estimate a probability of each mode. `all`: all failures.
        centre: centre of a mode that its eigenfailure shows. `median`: the median of the noise of
            its failures at each step. `mean`: the mean of its failures in PCA space, taken back to
            noise, as in the paper.
        features: what failures are grouped by. `behaviour`: the acceleration of the ego in the last
            seconds before the collision, and the vehicle that it struck, where it struck several;
            where that is not stored of all failures, the energy of the noise in windows of 0.5 s;
            where steps have no duration, the noise.
            `AnalysisResult.features` says which of these it was. `noise`: the principal components
            of the noise, as in the paper.
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
        failures: how many failures belong to it.
        medoid: index of the real episode nearest to the centre, by the features that failures are
            grouped by.
        centre: mean of its failures in the PCA space of the noise, shape (components,).
        eigenfailure: the centre of its noise, as `AnalysisSettings.centre` says: z, shape (steps,
            channels), aligned at the start and ready to be injected; of a channel that was left
            out, the median or mean of its failures. [sigma]
        medoid_campaign: the campaign of the medoid; None: the one that was analysed.
        probability: probability of a failure of this mode under p(x), where the campaign's method
            estimates it; None otherwise.
        band: band from the 10 % to the 90 % quantile of its failures' z at each step, of those that
            lasted so long, shape (2, steps, channels), aligned as `eigenfailure`. [sigma]
        components: principal components of the noise of its failures alone, shape (at most as many
            as the analysis has, steps, channels), in its alignment; None if failures were
            grouped by their noise.
        explained: share of the variance of its failures' noise that each of them explains.
        number: its number in the analysis, from 1, as pages and commands have it; 0 of a mode that
            belongs to no result.
        drawn: scenario parameters that its medoid drew, by name; none if none vary.
        lasting: number of steps that at least half of its failures lasted; 0 if it is not known.
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

        Only a few failures, which lasted longer, have the steps after these.
        """
        return self.eigenfailure[: self.lasting or None]


LONGEST_MODE_NAME = 80
"""Characters of the name of a mode."""


class Mode(Shown, msgspec.Struct, frozen=True):
    """A failure mode of an analysis, by number and name.

    Attributes:
        analysis: id of the analysis.
        number: its number there, from 1.
        failures: how many failures belong to it.
        name: the name that was given to it; until then the beginning of its description.
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
        mean: mean of its acceleration at each step over the failures of the mode, shape (steps,).
            [m/s²]
        members: its acceleration in some of these failures, evenly spread over them, shape
            (at most 20, steps). [m/s²]
        words: description of it in a sentence.
    """

    mean: Floats
    members: Floats
    words: str


class Behaviour(Brief, msgspec.Struct, frozen=True, eq=False):
    """The behaviour of the ego by which failures were grouped.

    Attributes:
        origin: moment from which times count: the `collision`; or the `start`, where failures need
            not end in a collision.
        times_s: time at the end of each step, up to 0 at the collision, shape (steps,). [s]
        explained: share of the variance of the acceleration, and of the vehicles in `struck`, that
            each principal component explains.
        scores: failures in the space of these components, shape (failures, components). [m/s²]
        modes: the behaviour in each mode, in their order.
        struck: number of the vehicle that the ego struck in each failure, in the order of the rows,
            where failures were grouped by it, too; empty otherwise.
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
    """Return the names of the modes of an analysis that were given none, each another one.

    A name is the beginning of the first sentence of the description, up to the end of a phrase.
    If another mode has the same, it is the longest beginning of the whole description that fits,
    with the number of the mode in parentheses; and "Mode 3" where none fits.

    Args:
        words: the descriptions in the order of the modes; empty ones give "Mode 3" and the like.
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
    """Return the beginnings of a text that end with a phrase and fit, the shortest first."""
    ends = [found.start() for found in _PHRASE_ENDS.finditer(text)] + [len(text)]
    return [text[:end] for end in ends if 0 < end <= LONGEST_MODE_NAME]


def _tell_apart(number: int, name: str, names: Sequence[str], beginnings: Sequence[str]) -> str:
    """Return a name that no other mode has, if need be with more of its description and a number.

    A name that ends with the number of another mode is not kept: that mode may be called so.
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
        components: shape (components, steps, channels); signs fixed so that the largest entry is
            positive; zero in a channel that was left out.
        scores: the data in PCA space D* = (D - mu) V_k, shape (failures, components).
        labels: the mode of each failure, by position in `modes`, from 0; pages, tables and data
            frames number modes from 1.
        silhouette: silhouette of the clustering, from -1 to 1; None with a single mode.
        noise_silhouette: the largest that the same clustering reaches on 19 draws of data without
            groups, of the same covariance and the same distances from the centre.
        influence: how much each step matters, shape (steps, channels): component magnitudes
            weighted by explained variance.
        diversity: how the failures spread over modes.
        campaigns: the campaign of each row; empty: the one that was analysed.
        stability: stability of the clusters; None with a single mode, or without bootstrap.
        outliers: share of the failures that the clusterer left out, before they were put with
            their nearest neighbour; 0 but for `hdbscan`.
        moments: the steps of greatest influence of each channel, the greatest first.
        before_collision: how much influence lies in the last seconds before the collision.
        training: ten intervals of the episodes, in order.
        sources: the campaigns, as they stood.
        words: what each mode is, in words; as many as there are modes.
        notes: remarks on the failures that were pooled.
        digest: SHA-256 over all of it but words, bands, behaviour and names of channels: the same
            whenever the analysis is repeated.
        channels: the names of the components of the noise at each step, in order.
        features: what the failures were grouped by. Components, scores and influence are of their
            noise in any case.
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
        """Yield the modes of the analysis with this id, with the names that are proposed."""
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
        """Share of the variance that each component and those before it explain together."""
        return np.cumsum(self.explained, dtype=np.float32)

    @property
    def distinct(self) -> bool:
        """Whether the modes are more than what clustering finds in data without groups."""
        return self.above_noise and self.stable

    @property
    def above_noise(self) -> bool:
        """Whether the silhouette exceeds that of data without groups."""
        return (
            self.silhouette is not None
            and self.noise_silhouette is not None
            and self.silhouette > self.noise_silhouette
        )

    @property
    def stable(self) -> bool:
        """Whether the modes come back under the bootstrap, as far as that was tried."""
        return self.stability is None or self.stability.median >= STABLE

    @property
    def caution(self) -> str:
        """The doubts about distinct modes in spite of the verdict; empty if nothing does.

        Empty, too, where the verdict itself says that there are none.
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
        """The word for one of its clusters: a mode, or a group where they are not distinct."""
        return "mode" if self.distinct else "group"

    @property
    def verdict(self) -> str:
        """Whether there are modes, and why."""
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
        """Return the number of distinct modes, and of those with too few failures to show one."""
        few = sum(mode.failures < FEWEST_OF_MODE for mode in self.modes)
        shown = len(self.modes) - few
        words = "1 distinct mode" if shown == 1 else f"{shown} distinct modes"
        return f"{words}, {few} more with too few failures" if few else words


class Analysis(Brief, Shown, msgspec.Struct, frozen=True, eq=False):
    """Current state of an analysis.

    Attributes:
        problem: why it failed, with the remedy; empty otherwise.
    """

    id: int
    campaign: int
    settings: AnalysisSettings
    state: AnalysisState
    created_ms: int
    result: AnalysisResult | None = None
    problem: str = ""


class MinimalFailure(msgspec.Struct, frozen=True, kw_only=True):
    """A failure, as far as a campaign of `minimal` has shrunk it.

    Attributes:
        campaign: the one that shrank it; with `index` the episode whose noise is described.
        done: whether the search came to its end: no step of one channel can be left out, and the
            whole cannot be weaker, without losing the failure.
        because: why the search is where it is, in words.
        words: what the noise does, in words.
        needed: pairs of a step and a channel that still hold noise; at first `injected` did.
        energy: sum of z² over them; `full_energy` at first. [sigma²]
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
