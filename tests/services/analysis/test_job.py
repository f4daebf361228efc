"""The whole analysis: planted modes, an independent computation, and what little data gives."""

from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.metrics import adjusted_rand_score
from threadpoolctl import threadpool_info, threadpool_limits

from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.presentation.analyses import tabulate_modes
from eigenfail.values.analysis import AnalysisResult, AnalysisSettings
from eigenfail.values.records import Failures
from eigenfail_services.analysis import clusters, job
from eigenfail_services.analysis.job import analyse, hash_result

HORIZON = 100
DEFAULT = AnalysisSettings(bootstrap=0)


@pytest.fixture
def few_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where modes are far above noise, few draws of it are enough."""
    monkeypatch.setattr(clusters, "NOISE_DRAWS", 4)


@pytest.mark.usefixtures("few_draws")
@pytest.mark.parametrize("spread", [0.3, 1.0, 1.5, 2.0])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_planted_modes_are_found(plant: Callable[..., Any], seed: int, spread: float) -> None:
    planted = plant(seed, spread)
    result = analyse(planted.failures, HORIZON, DEFAULT)
    assert result.distinct
    assert adjusted_rand_score(planted.labels, result.labels) >= 0.97
    assert [mode.failures for mode in result.modes] == pytest.approx([90, 60, 40], abs=2)
    for mode, truth in zip(result.modes, planted.modes, strict=True):
        error = np.sqrt(np.mean((mode.eigenfailure - truth) ** 2))
        assert error <= 0.05 + 0.2 * spread


@pytest.mark.usefixtures("few_draws")
def test_modes_that_noise_buries_are_not_called_modes(plant: Callable[..., Any]) -> None:
    """At 2 sigma around modes of 2 to 2.5 they are found; at 4 nobody could."""
    planted = plant(0, 4.0)
    result = analyse(planted.failures, HORIZON, AnalysisSettings(bootstrap=5))
    assert adjusted_rand_score(planted.labels, result.labels) < 0.6
    assert not result.distinct
    assert result.verdict.startswith("No distinct modes")


@pytest.mark.usefixtures("few_draws")
def test_planted_modes_come_back_under_the_bootstrap(plant: Callable[..., Any]) -> None:
    result = analyse(plant(0, 1.0).failures, HORIZON, AnalysisSettings(bootstrap=5))
    assert result.stability.median == pytest.approx(1.0, abs=0.05)
    assert result.verdict.startswith("3 distinct modes (silhouette 0.7")


CHANNELS = ("gust", "drift", "bias", "glare", "delay")


def plant_channels(count: int) -> tuple[Failures, np.ndarray]:
    """Two modes, of opposite sign in the last channel; the other channels are noise."""
    generator = np.random.default_rng(count)
    labels = np.repeat([0, 1], [50, 30])
    noise = 0.5 * generator.standard_normal((len(labels), 20, count))
    noise[:, 5:12, -1] += np.where(labels, -2.0, 2.0)[:, None]
    return Failures(tuple(range(len(labels))), tuple(noise.astype(np.float32))), labels


@pytest.mark.usefixtures("few_draws")
@pytest.mark.parametrize("count", [1, 3, 5])
@pytest.mark.parametrize("alone", [False, True])
def test_modes_are_found_in_any_number_of_channels(count: int, alone: bool) -> None:
    failures, labels = plant_channels(count)
    channels = CHANNELS[:count]
    asked = AnalysisSettings(axes=channels[-1] if alone else "joint", bootstrap=2, centre="mean")
    result = analyse(failures, 20, asked, channels)
    assert result.channels == channels
    assert result.labels == tuple(labels.tolist())
    assert result.components.shape == (3, 20, count)
    assert result.influence.shape == (20, count)
    assert {moment.axis for moment in result.moments[-3:]} == {channels[-1]}
    assert result.training[0].mean.shape == (20, count)
    noise = np.array(failures.noise, np.float64)
    for label, mode in enumerate(result.modes):
        members = noise[labels == label]
        assert mode.eigenfailure.shape == (20, count)
        assert mode.eigenfailure[5:12, -1] == pytest.approx((2.0, -2.0)[label], abs=0.5)
        assert mode.band == pytest.approx(np.quantile(members, (0.1, 0.9), axis=0), abs=1e-5)
        if alone:  # of a channel left out, the mean of its failures
            rest = members[:, :, :-1].mean(axis=0)
            assert mode.eigenfailure[:, :-1] == pytest.approx(rest, abs=1e-5)
    assert result.components[:, :, :-1].any() == (count > 1 and not alone)
    assert result.diversity
    assert result.diversity.spread == pytest.approx(
        float(np.sqrt(np.mean(noise.var(axis=0, ddof=1))))
    )


def test_names_of_channels_are_no_part_of_the_digest() -> None:
    failures, _ = plant_channels(2)
    asked = AnalysisSettings(clusters=2, bootstrap=0)
    one, other = analyse(failures, 20, asked), analyse(failures, 20, asked, ("gust", "drift"))
    assert one.channels == ("longitudinal", "lateral")
    assert hash_result(one) == hash_result(msgspec.structs.replace(one, channels=("a", "b")))
    assert [each.axis for each in other.moments] != [each.axis for each in one.moments]


def test_a_channel_that_the_noise_has_not_is_refused_and_the_nearest_named() -> None:
    failures, _ = plant_channels(3)
    with pytest.raises(UnknownName, match=r"axes: 'gusts' is not known\. Did you mean 'gust'\?"):
        analyse(failures, 20, AnalysisSettings(axes="gusts"), CHANNELS[:3])
    with pytest.raises(InvalidValue, match=r"not finite of shape \(at most 20, 2\)"):
        analyse(failures, 20, DEFAULT)


def test_an_eigenfailure_is_the_median_of_the_noise_at_each_step(
    failures_of: Callable[..., Failures],
) -> None:
    """One failure of nine is ten times as strong, and half of them end early."""
    random = np.random.default_rng(3)
    noise = [random.normal(2.0, 0.3, (6 if n % 2 else 10, 2)) for n in range(9)]
    noise[4] *= 10.0
    asked = AnalysisSettings(clusters=1, bootstrap=0)
    (mode,) = analyse(failures_of(noise), HORIZON, asked).modes
    long = [z for z in noise if len(z) == 10]
    assert mode.eigenfailure[:6] == pytest.approx(np.median([z[:6] for z in noise], axis=0))
    assert mode.eigenfailure[6:10] == pytest.approx(np.median([z[6:] for z in long], axis=0))
    assert not mode.eigenfailure[10:].any()
    (paper,) = analyse(
        failures_of(noise), HORIZON, AnalysisSettings(clusters=1, bootstrap=0, centre="mean")
    ).modes
    assert paper.eigenfailure[:6].mean() > 3.0 > mode.eigenfailure[:6].mean()


def test_structureless_failures_have_no_distinct_modes(
    structureless: Callable[[int], Failures],
) -> None:
    ways = (
        AnalysisSettings(align="start", clusters=3, bootstrap=0),
        AnalysisSettings(align="collision", clusters=3, bootstrap=0),
    )
    results = [analyse(structureless(seed), HORIZON, ways[seed % 2]) for seed in range(6)]
    assert sum(result.distinct for result in results) <= 1
    assert all(len(result.modes) == 3 for result in results)


def test_it_agrees_with_an_independent_computation(
    structureless: Callable[[int], Failures],
) -> None:
    failures = structureless(11)
    result = analyse(
        failures, HORIZON, AnalysisSettings(components=4, clusters=3, bootstrap=0, centre="mean")
    )
    data = np.array([np.pad(z, ((0, HORIZON - len(z)), (0, 0))).ravel() for z in failures.noise])
    mean = data.mean(axis=0, dtype=np.float64)
    _, singular, axes = np.linalg.svd(data - mean, full_matrices=False)
    axes = axes[:4] * np.sign(axes[range(4), np.abs(axes[:4]).argmax(axis=1)])[:, None]
    shares = (singular**2 / np.sum(singular**2))[:4]
    scores = (data - mean) @ axes.T
    assert result.episodes == failures.indices
    assert result.explained == pytest.approx(shares, rel=1e-5)
    assert result.components == pytest.approx(axes.reshape(4, HORIZON, 2), abs=1e-5)
    assert result.scores == pytest.approx(scores, abs=1e-4)
    weights = np.abs(axes) * shares[:, None]
    assert result.influence == pytest.approx(weights.sum(axis=0).reshape(HORIZON, 2), abs=1e-5)
    check_modes(result, scores, lambda centre: (centre @ axes + mean).reshape(HORIZON, 2))


def check_modes(
    result: AnalysisResult, scores: np.ndarray, back: Callable[[np.ndarray], np.ndarray]
) -> None:
    labels = np.array(result.labels)
    for label, mode in enumerate(result.modes):
        members = scores[labels == label]
        centre = members.mean(axis=0)
        nearest = np.argmin(np.sum((members - centre) ** 2, axis=1))
        assert mode.failures == len(members)
        assert mode.centre == pytest.approx(centre, abs=1e-4)
        assert mode.medoid == np.array(result.episodes)[labels == label][nearest]
        assert mode.eigenfailure == pytest.approx(back(centre), abs=1e-4)


def test_aligned_at_the_collision_the_eigenfailure_strikes_when_failures_did(
    failures_of: Callable[..., Failures],
) -> None:
    """All failures push in their last ten steps; half of them collide at 60, half at 64."""
    noise = [np.zeros((steps, 2)) for steps in (60, 64) * 20]
    for z in noise:
        z[-10:, 0] = 3.0
    settings_ = AnalysisSettings(align="collision", clusters=1, bootstrap=0)
    (mode,) = analyse(failures_of(noise), HORIZON, settings_).modes
    expected = np.zeros((HORIZON, 2))
    expected[54:64, 0] = 3.0
    assert mode.eigenfailure == pytest.approx(expected, abs=1e-6)
    # The middle lengths differ: the last steps before the collision are typical all the same.
    assert mode.lasting == len(mode.typical) == 64


def test_what_one_long_failure_does_alone_is_not_typical(
    failures_of: Callable[..., Failures],
) -> None:
    noise = [np.full((steps, 2), 0.5) for steps in (30, 30, 90)]
    noise[-1][80:] = 4.0
    asked = AnalysisSettings(clusters=1, bootstrap=0)
    result = analyse(failures_of(noise), HORIZON, asked)
    (mode,) = result.modes
    assert mode.eigenfailure.max() == pytest.approx(4.0)
    assert mode.lasting == 30
    assert mode.typical.max() == pytest.approx(0.5)
    (row,) = tabulate_modes(1, result).cells
    assert [cell.value for cell in row[3:7]] == ["+0.500", "+0.500", *["+0.500 at step 0"] * 2]


@pytest.mark.parametrize("align", ["start", "collision"])
def test_it_is_the_same_whenever_it_is_repeated(
    structureless: Callable[[int], Failures], align: Any
) -> None:
    asked = AnalysisSettings(align=align, clusters=4, bootstrap=0)
    with threadpool_limits(limits=2):
        one = analyse(structureless(1), HORIZON, asked)
    with threadpool_limits(limits=1):
        other = analyse(structureless(1), HORIZON, asked)
    assert hash_result(one) == hash_result(other)
    assert len(hash_result(one)) == 64


def test_the_digest_sees_every_part(structureless: Callable[[int], Failures]) -> None:
    result = analyse(structureless(1), HORIZON, AnalysisSettings(clusters=1, bootstrap=0))
    digests = {hash_result(result)}
    for field in ("explained", "components", "scores", "influence"):
        changed = getattr(result, field).copy()
        changed.flat[-1] = np.nextafter(changed.flat[-1], np.float32(9))
        digests.add(hash_result(replaced(result, field, changed)))
    digests.add(hash_result(replaced(result, "silhouette", 0.5)))
    digests.add(hash_result(replaced(result, "labels", (1, *result.labels[1:]))))
    assert len(digests) == 7
    assert hash_result(replaced(result, "words", ("Mode 1: said by chance.",))) in digests
    assert hash_result(replaced(result, "digest", "0" * 64)) in digests


def replaced(result: AnalysisResult, field: str, value: Any) -> AnalysisResult:
    parts = {name: getattr(result, name) for name in result.__struct_fields__}
    return AnalysisResult(**(parts | {field: value}))


def test_it_counts_on_one_thread(
    monkeypatch: pytest.MonkeyPatch, failures_of: Callable[..., Failures]
) -> None:
    threads: set[int] = set()

    def fit(*arguments: Any) -> Any:
        threads.update(pool["num_threads"] for pool in threadpool_info())
        return real(*arguments)

    real = job.fit_components
    monkeypatch.setattr(job, "fit_components", fit)
    with threadpool_limits(limits=2):
        analyse(failures_of([np.ones((2, 2))]), HORIZON, DEFAULT)
    assert threads == {1}


@pytest.mark.fault(
    "few, identical or constant failures, or none",
    group="plug-ins",
    outcome="The analysis returns one mode, or refuses with the reason.",
)
@pytest.mark.parametrize("align", ["start", "collision"])
@pytest.mark.parametrize("wanted", [None, 1, 2, 5])
@pytest.mark.parametrize("count", [1, 2])
def test_one_or_two_failures_are_one_mode(
    failures_of: Callable[..., Failures], count: int, wanted: int | None, align: Any
) -> None:
    noise = list(np.random.default_rng(0).standard_normal((count, 9, 2)))
    result = analyse(
        failures_of(noise), 9, AnalysisSettings(align=align, clusters=wanted, bootstrap=0)
    )
    (mode,) = result.modes
    assert mode.failures == count
    assert mode.eigenfailure == pytest.approx(np.mean(noise, axis=0), abs=1e-6)
    assert result.labels == (0,) * count
    assert len(result.explained) == count - 1
    assert result.silhouette is result.noise_silhouette is None
    assert not result.distinct


@pytest.mark.fault("few, identical or constant failures, or none")
def test_identical_failures_are_one_mode(failures_of: Callable[..., Failures]) -> None:
    z = np.random.default_rng(0).standard_normal((9, 2)).astype(np.float32)
    result = analyse(failures_of([z] * 40), 12, AnalysisSettings(clusters=3, bootstrap=0))
    (mode,) = result.modes
    assert (mode.failures, mode.medoid, mode.centre.shape) == (40, 3, (0,))
    assert mode.eigenfailure[:9] == pytest.approx(z)
    assert result.components.shape == (0, 12, 2)
    assert result.scores.shape == (40, 0)
    assert not result.influence.any()


@pytest.mark.fault("few, identical or constant failures, or none")
def test_fewer_failures_than_clusters_are_one_mode(failures_of: Callable[..., Failures]) -> None:
    noise = list(np.random.default_rng(0).standard_normal((4, 9, 2)))
    result = analyse(failures_of(noise), 9, AnalysisSettings(clusters=5, bootstrap=0))
    assert len(result.modes) == 1


@pytest.mark.fault("few, identical or constant failures, or none")
def test_constant_columns_have_no_influence(failures_of: Callable[..., Failures]) -> None:
    noise = np.random.default_rng(0).standard_normal((30, 9, 2))
    noise[:, :, 1] = 0.7
    result = analyse(failures_of(list(noise)), 9, AnalysisSettings(clusters=2, bootstrap=0))
    assert result.influence[:, 1].max() < 1e-9 < result.influence[:, 0].min()
    for mode in result.modes:
        assert mode.eigenfailure[:, 1] == pytest.approx(0.7)


@pytest.mark.fault("few, identical or constant failures, or none")
def test_failures_without_any_noise(failures_of: Callable[..., Failures]) -> None:
    result = analyse(failures_of([np.zeros((0, 2))] * 3), 5, DEFAULT)
    assert not result.modes[0].eigenfailure.any()


@pytest.mark.fault("few, identical or constant failures, or none")
def test_without_a_failure_there_is_nothing_to_analyse() -> None:
    with pytest.raises(InvalidValue, match=r"none to analyse.* ast, cem, difs") as caught:
        analyse(Failures((), ()), HORIZON, DEFAULT)
    assert caught.value.remedy


@pytest.mark.fault("worker that reports NaN")
@pytest.mark.parametrize(
    "z",
    [
        np.zeros((11, 2), np.float32),
        np.zeros((10, 3), np.float32),
        np.zeros(10, np.float32),
        np.array([[0.0, np.nan]], np.float32),
        np.array([[np.inf, 0.0]], np.float32),
    ],
)
def test_noise_that_does_not_fit_is_refused_by_episode(z: np.ndarray) -> None:
    good = np.zeros((10, 2), np.float32)
    with pytest.raises(InvalidValue, match="episode 8"):
        analyse(Failures((5, 8), (good, z)), 10, DEFAULT)


@st.composite
def some_failures(draw: st.DrawFn) -> list[np.ndarray]:
    """Few, short and often alike: where ties and degenerate directions live."""
    lengths = draw(st.lists(st.integers(0, 4), min_size=1, max_size=8))
    entry = st.integers(-2, 2).map(float) | st.floats(-3, 3, width=32)
    return [
        np.array(draw(st.lists(entry, min_size=2 * n, max_size=2 * n)), np.float32).reshape(n, 2)
        for n in lengths
    ]


@given(some_failures(), st.randoms(use_true_random=False), st.sampled_from([1, 2, 3]))
@settings(max_examples=25, deadline=None)
def test_the_order_of_the_failures_does_not_matter(
    noise: list[np.ndarray], random: Any, wanted: int
) -> None:
    asked = AnalysisSettings(clusters=wanted, align="collision", bootstrap=0)
    order = random.sample(range(len(noise)), len(noise))
    episodes = tuple(range(len(noise)))
    one = analyse(Failures(episodes, tuple(noise)), 4, asked)
    other = analyse(Failures(tuple(order), tuple(noise[i] for i in order)), 4, asked)
    assert other.episodes == episodes
    assert hash_result(other) == hash_result(one)


@given(some_failures(), st.integers(1, 5), st.sampled_from(["start", "collision"]))
@settings(max_examples=25, deadline=None)
def test_its_parts_fit_together(noise: list[np.ndarray], components: int, align: Any) -> None:
    episodes = tuple(range(10, 10 + len(noise)))
    asked = AnalysisSettings(align=align, components=components, clusters=2, bootstrap=0)
    result = analyse(Failures(episodes, tuple(noise)), 4, asked)
    count = len(result.explained)
    assert result.explained.sum() <= 1.0 + 1e-6
    assert (np.diff(result.explained) <= 1e-6).all()
    assert result.components.shape == (count, 4, 2)
    assert result.scores.shape == (len(noise), count)
    assert result.influence.shape == (4, 2)
    assert sorted(set(result.labels)) == list(range(len(result.modes)))
    for label, mode in enumerate(result.modes):
        members = [e for e, own in zip(result.episodes, result.labels, strict=True) if own == label]
        assert mode.failures == len(members)
        assert mode.medoid in members
        assert mode.centre.shape == (count,)
        assert mode.eigenfailure.shape == (4, 2)
        assert mode.eigenfailure.dtype == np.float32
    assert (result.silhouette is None) == (len(result.modes) == 1)
