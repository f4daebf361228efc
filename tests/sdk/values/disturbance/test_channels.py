"""Channels: events as Markov chains, a shape for each, and what a campaign may name."""

from itertools import product
from math import exp, log, pi
from statistics import NormalDist

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.channels import ALL_CHANNELS, PARAMETER, QUANTITIES, Channel, list_names
from eigenfail.values.disturbance import (
    DisturbanceModel,
    NoiseTrajectory,
    ScenarioCorrelation,
    find_channel_likelihoods,
)
from eigenfail.values.shapes import (
    Autoregressive,
    Correlated,
    HeavyTailed,
    Markov,
    Once,
    PerChannel,
    White,
)

CHAINS = (Markov(0.02, 8.0), Markov(0.5, 1.0), Markov(0.1, 2.5))
STEPS = 60_000


def draw(shape: Markov | PerChannel, columns: int = 1, seed: int = 1) -> NoiseTrajectory:
    z = np.random.default_rng(seed).standard_normal((STEPS, columns), dtype=np.float32)
    return NoiseTrajectory(z, np.ones_like(z), PerChannel((shape,)) if columns == 1 else shape)


@pytest.mark.parametrize("chain", CHAINS, ids=str)
def test_an_event_begins_and_lasts_as_its_chain_says(chain: Markov) -> None:
    lasts = draw(chain).injected[:, 0] > 0.5
    begins = lasts[1:][~lasts[:-1]]
    assert begins.mean() == pytest.approx(chain.rate, rel=0.1)
    assert lasts[1:][lasts[:-1]].mean() == pytest.approx(1.0 - 1.0 / chain.mean_steps, abs=0.03)
    share = chain.rate / (chain.rate + 1.0 / chain.mean_steps)
    assert lasts.mean() == pytest.approx(share, rel=0.1)


@pytest.mark.parametrize("chain", CHAINS, ids=str)
def test_an_event_is_stationary_from_its_first_step(chain: Markov) -> None:
    z = np.random.default_rng(2).standard_normal((20_000, 1))
    share = chain.rate / (chain.rate + 1.0 / chain.mean_steps)
    first = np.array([chain.step((each,), None, (1.0,))[0] for each in z[:, 0].tolist()])
    assert first.mean() == pytest.approx(share, abs=0.012)


@pytest.mark.parametrize("chain", CHAINS, ids=str)
def test_log_p_is_the_mass_of_the_events(chain: Markov) -> None:
    noise = draw(chain)
    before, expected = None, []
    for u in noise.injected[:300, 0].tolist():
        stationary = chain.rate / (chain.rate + 1.0 / chain.mean_steps)
        likely = {None: stationary, 0.0: chain.rate, 1.0: 1.0 - 1.0 / chain.mean_steps}[before]
        expected.append(log(likely if u else 1.0 - likely))
        before = u
    assert noise.log_probability_per_step[:300] == pytest.approx(expected, abs=1e-9)


RATED = Markov(0.02, 4.0, 0.002)
RATES = np.array([[0.05], [0.2], [0.5], [0.02]], np.float32)


def draw_rated(count: int) -> list[NoiseTrajectory]:
    z = np.random.default_rng(7).standard_normal((count, *RATES.shape), dtype=np.float32)
    return [NoiseTrajectory(each, RATES, PerChannel((RATED,))) for each in z]


def test_a_rate_that_depends_on_the_distance_is_that_of_each_step() -> None:
    lasts = np.array([noise.injected[:, 0] for noise in draw_rated(20_000)]) > 0.5
    assert lasts[:, 0].mean() == pytest.approx(0.05 / (0.05 + 0.25), abs=0.012)
    for step, rate in enumerate(RATES[1:, 0].tolist(), 1):
        before, now = lasts[:, step - 1], lasts[:, step]
        assert now[~before].mean() == pytest.approx(rate, abs=0.015)
        assert now[before].mean() == pytest.approx(0.75, abs=0.015)


def test_log_p_is_the_mass_at_the_rate_of_each_step() -> None:
    for noise in draw_rated(40):
        before, expected = None, []
        for u, rate in zip(noise.injected[:, 0].tolist(), RATES[:, 0].tolist(), strict=True):
            likely = {None: rate / (rate + 0.25), 0.0: rate, 1.0: 0.75}[before]
            expected.append(log(likely if u else 1.0 - likely))
            before = u
        assert noise.log_probability_per_step == pytest.approx(expected, abs=1e-9)
        back = NoiseTrajectory.from_injected(noise.injected, noise.sigma, noise.shape)
        assert back.injected.tolist() == noise.injected.tolist() == noise.standardised.tolist()


def test_the_masses_of_all_courses_of_an_event_add_up_to_one() -> None:
    masses = []
    for course in product((0.0, 1.0), repeat=len(RATES)):
        injected = np.array(course)[:, None]
        noise = NoiseTrajectory.from_injected(injected, RATES, PerChannel((RATED,)))
        assert noise.injected.tolist() == injected.tolist()
        masses.append(exp(noise.log_probability))
    assert sum(masses) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("reported", [0.0, -1.0, 7.0, np.nan, np.inf])
def test_whatever_rate_is_reported_log_p_is_a_number(reported: float) -> None:
    z = np.zeros((3, 1), np.float32)
    noise = NoiseTrajectory(z, np.full_like(z, reported), PerChannel((RATED,)))
    assert np.isfinite(noise.log_probability)


def test_a_constant_rate_is_written_as_before_it_could_grow() -> None:
    for chain in (Markov(), Markov(rate_per_m=0.0)):
        stored = Channel("missed", shape=chain).filled()
        assert stored.shape == Markov()
        assert b"rate_per_m" not in msgspec.json.encode(stored)
        assert stored.in_words().startswith("markov: begins with probability 0.01 a step")
    grown = Channel("missed", shape=Markov(rate_per_m=0.002)).filled()
    assert "probability 0.01 + 0.002·d a step" in grown.in_words()
    again = msgspec.json.decode(msgspec.json.encode(grown), type=Channel)
    assert again == grown


@settings(deadline=None, derandomize=True, max_examples=200)
@given(
    st.floats(-6.0, 6.0),
    st.floats(0.0, 6.0),
    st.sampled_from([None, (0.0,), (1.0,)]),
    st.sampled_from(CHAINS),
)
def test_a_larger_z_never_ends_an_event(z, more, before, chain) -> None:
    assert chain.step((z + more,), before, (1.0,)) >= chain.step((z,), before, (1.0,))


@pytest.mark.parametrize("chain", CHAINS, ids=str)
def test_events_come_back_from_what_was_injected(chain: Markov) -> None:
    noise = draw(chain)
    back = NoiseTrajectory.from_injected(noise.injected[:500], noise.sigma[:500], noise.shape)
    assert back.injected.tolist() == noise.injected[:500].tolist()


def test_each_channel_has_its_own_shape() -> None:
    shapes = (Autoregressive(0.9), White(), HeavyTailed(3.0), Markov(0.05, 4.0))
    noise = draw(PerChannel(shapes), 4)
    for way, shape in enumerate(shapes):
        alone = NoiseTrajectory(noise.z[:, [way]], noise.sigma[:, [way]], PerChannel((shape,)))
        assert alone.injected[:, 0].tolist() == noise.injected[:, way].tolist()
    apart = [
        NoiseTrajectory(noise.z[:, [way]], noise.sigma[:, [way]], PerChannel((shape,)))
        for way, shape in enumerate(shapes)
    ]
    total = sum(each.log_probability for each in apart)
    assert noise.log_probability == pytest.approx(total, rel=1e-9)


def test_what_is_drawn_once_stays_and_counts_once() -> None:
    noise = draw(PerChannel((Once(), White())), 2)
    assert set(noise.injected[:, 0].tolist()) == {float(noise.z[0, 0])}
    alone = NoiseTrajectory(noise.z[:, [1]], noise.sigma[:, [1]])
    first = -0.5 * float(noise.z[0, 0]) ** 2 - 0.5 * log(2.0 * pi)
    assert noise.log_probability == pytest.approx(alone.log_probability + first, rel=1e-9)
    back = NoiseTrajectory.from_injected(noise.injected[:9], noise.sigma[:9], noise.shape)
    assert back.injected == pytest.approx(noise.injected[:9], abs=1e-6)


def test_a_delay_has_one_density_in_its_own_unit() -> None:
    z = np.random.default_rng(4).standard_normal((7, 1)).astype(np.float32)
    noise = NoiseTrajectory(z, np.full((7, 1), 0.25, np.float32), PerChannel((Once(),)))
    assert noise.injected[:, 0] == pytest.approx(0.25 * z[0, 0])
    expected = NormalDist(0.0, 0.25).pdf(0.25 * float(z[0, 0]))
    assert noise.log_probability == pytest.approx(log(expected), rel=1e-6)


def test_two_channels_of_one_correlation_are_the_process_of_a_position() -> None:
    one = draw(PerChannel((Autoregressive(0.7), Autoregressive(0.7))), 2)
    other = NoiseTrajectory(one.z, one.sigma, Correlated(0.7, 0.7))
    assert one.injected == pytest.approx(other.injected, abs=1e-12)
    assert one.log_probability == pytest.approx(other.log_probability, rel=1e-12)


def test_a_model_without_channels_is_written_as_before_there_were_any() -> None:
    assert b"channels" not in msgspec.json.encode(DisturbanceModel())
    assert "channels" not in msgspec.to_builtins(DisturbanceModel())


def test_white_channels_of_the_position_are_the_papers_noise() -> None:
    model = DisturbanceModel(channels=(Channel("longitudinal"), Channel("lateral")))
    assert model.noise_shape == DisturbanceModel().noise_shape == White()
    bare = [(one.name, one.sigma, one.sigma_per_m) for one in model.list_channels()]
    assert bare == [("longitudinal", 1.0, 0.02), ("lateral", 0.2, 0.00625)]


def resolve(*channels: Channel, vehicles: int = 2, **fields: object) -> tuple[Channel, ...]:
    model = DisturbanceModel(channels=channels, **fields)  # type: ignore[arg-type]
    return model.resolve(vehicles, ALL_CHANNELS, ("gap_m", "speed")).list_channels()


def test_a_parameter_of_the_scenario_is_drawn_once() -> None:
    (found,) = resolve(Channel("scenario.speed"))
    assert found == Channel("scenario.speed", shape=Once())
    assert (found.unit, found.kind) == ("", PARAMETER)
    assert Channel("scenario.missed").kind is PARAMETER
    model = DisturbanceModel(channels=(found, Channel("speed")))
    assert model.searched_parameters == ("speed",)
    assert DisturbanceModel().searched_parameters == ()


def test_a_channel_of_every_vehicle_is_one_of_each() -> None:
    found = resolve(Channel("every.speed", 0.3), Channel("missed"))
    assert [one.name for one in found] == ["vehicle_1.speed", "vehicle_2.speed", "missed"]
    assert found[0] == Channel("vehicle_1.speed", 0.3, 0.0, White())
    assert found[2] == Channel("missed", None, None, Markov())


def test_every_known_name_resolves() -> None:
    names = list_names(2, ALL_CHANNELS)
    assert {name.rpartition(".")[2] for name in names} == set(QUANTITIES)
    for name in names:
        assert resolve(Channel(name))
        for channel in resolve(Channel(name)):
            assert channel.in_words()


FIELDS = ("longitudinal", "lateral", "heading", "speed", "length", "width")


@pytest.mark.parametrize(
    ("channels", "kind", "words"),
    [
        ((Channel("vehicle_3.speed"),), UnknownName, r"channels\[0\].name: 'vehicle_3.speed'"),
        ((Channel("speed"), Channel("sped")), UnknownName, r"\[1\].*Did you mean 'speed'"),
        ((Channel("ego.length"),), UnknownName, "ego.length"),
        ((Channel("every.ghost"),), UnknownName, "every.ghost"),
        ((Channel("speed"), Channel("speed")), InvalidValue, "'speed' is there twice"),
        ((Channel("every.speed"), Channel("vehicle_2.speed")), InvalidValue, "vehicle_2.speed"),
        ((Channel("missed", sigma=1.0),), InvalidValue, "no standard deviation"),
        ((Channel("missed", sigma_per_m=1.0),), InvalidValue, "no standard deviation"),
        ((Channel("missed", shape=White()),), InvalidValue, r"shape.*Take markov"),
        ((Channel("speed", shape=Markov()),), InvalidValue, r"shape.*white, ar1, student_t"),
        ((Channel("every.swapped"),), UnknownName, "every.swapped"),
        ((Channel("swapped", sigma=1.0),), InvalidValue, "no standard deviation"),
        ((Channel("swapped", shape=RATED),), InvalidValue, r"shape.rate_per_m.*no vehicle"),
        ((Channel("ghost", shape=RATED),), InvalidValue, r"shape.rate_per_m.*no vehicle"),
        ((Channel("speed", ahead_m=3.0),), InvalidValue, "ahead_m"),
        ((Channel("scenario.width"),), UnknownName, "scenario.gap_m"),
        ((Channel("scenario.gap_m", 1.0),), InvalidValue, "its distribution from"),
        ((Channel("scenario.gap_m", shape=White()),), InvalidValue, r"shape.*Take once"),
        ((Channel("delay", shape=White()),), InvalidValue, r"shape.*Take once"),
        ((Channel("delay", 0.2, 0.1),), InvalidValue, r"sigma_per_m.*however far"),
        ((Channel("speed", shape=Once()),), InvalidValue, r"shape.*Take white, ar1, student_t"),
    ],
)
def test_what_cannot_be_is_refused(channels, kind, words) -> None:
    with pytest.raises(kind, match=words):
        resolve(*channels)


def test_numbers_are_swapped_where_there_are_two_vehicles() -> None:
    assert resolve(Channel("swapped"))[0].shape == Markov()
    with pytest.raises(InvalidValue, match="two vehicles, of which there is one") as refused:
        resolve(Channel("speed"), Channel("swapped"), vehicles=1)
    assert refused.value.field == "disturbance.channels[1].name"


def correlate(*pairs: tuple[str, str, float], channels: bool = True) -> DisturbanceModel:
    names = [f"scenario.{name}" for name in ("a", "b", "c")]
    return DisturbanceModel(
        channels=tuple(map(Channel, (*names, "speed"))) if channels else msgspec.UNSET,
        correlations=tuple(ScenarioCorrelation((one, other), r) for one, other, r in pairs),
    )


A, B, C = "scenario.a", "scenario.b", "scenario.c"


def test_correlations_are_those_of_parameters_in_the_order_of_their_channels() -> None:
    model = correlate((B, A, 0.5), (B, C, -0.25))
    model.check_correlations()
    assert model.parameter_correlations == {("b", "a"): 0.5, ("b", "c"): -0.25}
    assert model.in_words()["correlation of b and a"] == "0.5"
    again = msgspec.json.decode(msgspec.json.encode(model), type=DisturbanceModel)
    assert again == model
    assert b"correlations" not in msgspec.json.encode(DisturbanceModel())


@pytest.mark.parametrize(
    ("model", "kind", "field", "words"),
    [
        (correlate((A, "scenario.d", 0.5)), UnknownName, "[0].channels", "scenario.d"),
        (correlate((A, B, 0.5), (A, "speed", 0.5)), UnknownName, "[1].channels", "speed"),
        (correlate((A, B, 0.5), channels=False), UnknownName, "[0].channels", A),
        (correlate((A, A, 0.5)), InvalidValue, "[0].channels", "cannot be correlated"),
        (correlate((A, B, 0.5), (B, A, 0.1)), InvalidValue, "[1].channels", "each pair once"),
        (
            correlate((A, B, 0.9), (B, C, 0.9), (A, C, -0.9)),
            InvalidValue,
            "",
            r"not positive definite: its smallest eigenvalue is -0\.8",
        ),
    ],
)
def test_correlations_that_cannot_be_are_refused_by_field(model, kind, field, words) -> None:
    with pytest.raises(kind, match=words) as refused:
        model.check_correlations()
    assert refused.value.field == f"disturbance.correlations{field}"


@pytest.mark.parametrize("coefficient", [1.0, -1.0, float("nan"), 3.0])
def test_a_coefficient_is_between_minus_one_and_one(coefficient: float) -> None:
    given_ = {"correlations": [{"channels": [A, B], "coefficient": coefficient}]}
    with pytest.raises(msgspec.ValidationError, match="coefficient"):
        msgspec.convert(given_, DisturbanceModel)


def test_there_are_not_too_many_channels_one_by_one() -> None:
    every = tuple(Channel(f"every.{name}") for name in FIELDS)
    assert len(resolve(*every, vehicles=8)) == 48
    with pytest.raises(InvalidValue, match="54 channels, one by one, are more than 50"):
        resolve(*every, vehicles=9)


def test_what_a_simulator_does_not_offer_is_refused() -> None:
    model = DisturbanceModel(channels=(Channel("heading"),))
    with pytest.raises(UnknownName, match=r"Known: lateral, longitudinal\."):
        model.resolve(2, frozenset({"longitudinal", "lateral"}))


@pytest.mark.parametrize(
    "fields", [{"lateral_base_m": 0.5}, {"shape": HeavyTailed()}, {"longitudinal_slope": 0.0}]
)
def test_fields_of_the_position_do_not_go_with_channels(fields) -> None:
    with pytest.raises(InvalidValue, match="do not apply where channels are named"):
        resolve(Channel("speed"), **fields)
    assert resolve(Channel("speed"), scale=2.0)


@pytest.mark.parametrize(
    "wrong",
    [
        '{"channels": []}',
        '{"channels": [{}]}',
        '{"channels": [{"name": "speed", "sigma": 0}]}',
        '{"channels": [{"name": "speed", "sigma": NaN}]}',
        '{"channels": [{"name": "speed", "colour": 1}]}',
        '{"channels": [{"name": "speed", "shape": {"kind": "per_channel", "shapes": []}}]}',
        '{"channels": [{"name": "missed", "shape": {"kind": "markov", "rate": 0}}]}',
        '{"channels": [{"name": "missed", "shape": {"kind": "markov", "mean_steps": 0.5}}]}',
        '{"channels": [{"name": "missed", "shape": {"kind": "markov", "rate_per_m": -0.1}}]}',
        '{"channels": [{"name": "missed", "shape": {"kind": "markov", "rate_per_m": 0.6}}]}',
    ],
)
def test_what_is_no_model_is_not_read(wrong: str) -> None:
    with pytest.raises((msgspec.ValidationError, msgspec.DecodeError)):
        msgspec.json.decode(wrong, type=DisturbanceModel)


@pytest.mark.parametrize("name", ["rate", "mean_steps", "rate_per_m"])
def test_no_number_of_an_event_is_nan(name: str) -> None:
    with pytest.raises(msgspec.ValidationError, match=name):
        msgspec.convert({"kind": "markov", name: float("nan")}, Markov)


def test_models_are_alike_with_their_channels_written_out() -> None:
    given = DisturbanceModel(channels=(Channel("every.speed"), Channel("missed")))
    stored = given.resolve(3, ALL_CHANNELS)
    assert given != stored
    assert given.is_like(stored)
    assert stored.is_like(given)
    assert not stored.is_like(DisturbanceModel(channels=(Channel("every.speed"),)))
    assert not DisturbanceModel(channels=(Channel("every.heading"),)).is_like(stored)
    assert not DisturbanceModel().is_like(stored)
    assert DisturbanceModel(scale=2.0).is_like(DisturbanceModel(scale=2.0))
    assert not DisturbanceModel(scale=2.0).is_like(DisturbanceModel())
    spec = CampaignSpec(name="a", method="held", episodes=1, disturbance=given)
    assert spec.is_like(msgspec.structs.replace(spec, disturbance=stored))
    assert not spec.is_like(msgspec.structs.replace(spec, seed=1, disturbance=stored))


def test_an_event_that_is_rounded_stays_rounded() -> None:
    chain = PerChannel((Markov(0.05, 4.0),))
    half = np.array([[0.3], [0.7], [0.3]])
    back = NoiseTrajectory.from_injected(half, np.ones((3, 1), np.float32), chain)
    assert back.injected.tolist() == [[0.0], [1.0], [0.0]]


def test_the_parts_of_the_channels_are_those_of_each_alone_and_add_up_to_log_p() -> None:
    shapes = (Autoregressive(0.9), HeavyTailed(3.0), Markov(0.05, 4.0), RATED, Once(), White())
    z = np.random.default_rng(3).standard_normal((40, len(shapes)), dtype=np.float32)
    sigma = np.full_like(z, 0.25)
    sigma[:, 2] = 1.0
    names = [f"channel_{number}" for number in range(len(shapes))]
    noise = NoiseTrajectory(z, sigma, PerChannel(shapes))
    found = find_channel_likelihoods(noise, names)
    assert [each.name for each in found] == names
    total = sum(each.log_probability or 0.0 for each in found)
    assert total == pytest.approx(noise.log_probability, rel=1e-12)
    for way, (shape, each) in enumerate(zip(shapes, found, strict=True)):
        alone = NoiseTrajectory(z[:, [way]], sigma[:, [way]], PerChannel((shape,)))
        assert each.log_probability == pytest.approx(alone.log_probability, rel=1e-9)
        counted = z[:1, way] if isinstance(shape, Once) else z[:, way]
        assert each.relative == pytest.approx(-0.5 * float((counted.astype(float) ** 2).sum()))
    assert find_channel_likelihoods(NoiseTrajectory(z[:0], sigma[:0], noise.shape), names) == ()


def test_of_white_noise_it_is_relative_to_the_most_likely_noise_of_the_same_steps() -> None:
    z = np.random.default_rng(4).standard_normal((30, 2), dtype=np.float32)
    sigma = np.full_like(z, 0.4)
    found = find_channel_likelihoods(NoiseTrajectory(z, sigma), ("x", "y"))
    none = find_channel_likelihoods(NoiseTrajectory(0.0 * z, sigma), ("x", "y"))
    for each, likeliest in zip(found, none, strict=True):
        gain = each.log_probability - likeliest.log_probability
        assert each.relative == pytest.approx(gain, rel=1e-9)
        assert likeliest.relative == 0.0


def test_noise_without_a_density_has_no_likelihood() -> None:
    z = np.full((2, 1), np.inf, np.float32)
    (found,) = find_channel_likelihoods(NoiseTrajectory(z, np.ones_like(z)), ("x",))
    assert (found.log_probability, found.relative) == (None, None)


def test_a_number_that_a_simulator_shows_has_a_sigma_without_a_unit() -> None:
    offered = frozenset({*ALL_CHANNELS, "observation.3"})
    model = DisturbanceModel(channels=(Channel("observation.3", sigma=0.2),))
    (channel,) = model.resolve(1, offered).list_channels()
    assert (channel.unit, channel.sigma, channel.sigma_per_m) == ("", 0.2, 0.0)
    assert Channel("observation.3").filled().sigma == 1.0
    with pytest.raises(UnknownName, match=r"'observation\.4' is not known"):
        DisturbanceModel(channels=(Channel("observation.4"),)).resolve(1, offered)
