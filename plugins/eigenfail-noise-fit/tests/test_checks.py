"""Checks name what makes errors look heavy-tailed, and parameters that lie on their bounds."""

from math import pi

import numpy as np
import pytest

from eigenfail_noise_fit.checks import SEE_CAUSE, check_channels, check_position
from eigenfail_noise_fit.fitting import CANDIDATES, Fit, make_likelihood
from eigenfail_noise_fit.jackknife import ShapeScore, maximize_likelihood
from eigenfail_noise_fit.report import fit_log
from eigenfail_noise_fit.sensor_log import Row, make_log

TRACKS, STEPS = 40, 40
CHANNELS = ("longitudinal", "lateral", "heading")


def draw(seed=1, bend=None, digits=None):
    """A log of white errors of position and heading that are bent.

    `bend` changes the reported values, shape (tracks, steps, 3), given the true ones.
    """
    random = np.random.default_rng(seed)
    true = np.zeros((TRACKS, STEPS, 3))
    true[..., 0] = random.uniform(10.0, 80.0, (TRACKS, 1)) + 0.2 * np.arange(STEPS)
    true[..., 1] = random.uniform(-4.0, 4.0, (TRACKS, 1)) + 0.01 * np.arange(STEPS)
    true[..., 2] = random.uniform(-0.1, 0.1, (TRACKS, STEPS))
    seen = true + random.standard_normal(true.shape) * [0.5, 0.2, 0.03]
    if bend is not None:
        seen = bend(seen, true, random)
    if digits is not None:
        true, seen = true.round(digits), seen.round(digits)
    return make_log(
        [
            Row(str(n), 0.1 * k, (*true[n, k, :2], *seen[n, k, :2]), (true[n, k, 2], seen[n, k, 2]))
            for n in range(TRACKS)
            for k in range(STEPS)
        ],
        0.1,
        ("heading",),
    )


def fit(log, kind="white"):
    """The fits of one shape to each channel."""
    (candidate,) = [each for each in CANDIDATES if each.kind == kind]
    fits = []
    for name in CHANNELS:
        best = maximize_likelihood(make_likelihood(candidate, log.select(name)))
        fits.append(Fit(candidate, (name,), best, ShapeScore(0.0, None)))
    return fits


CAUSES = (
    "near ",
    "exactly 0",
    "values that are",
    "ratio of changes",
    "range of",
    "between tracks",
    "beyond 45°",
)


def list_causes(log, kind="white"):
    checks = check_channels(log, fit(log, kind), ())
    return [check for check in checks if any(words in check.name for words in CAUSES)]


def pick(random, share):
    return random.uniform(size=(TRACKS, STEPS)) < share


def turn(angle, share):
    def bend(seen, _true, random):
        seen[..., 2] += angle * pick(random, share)
        return seen

    return bend


def put(value, share, columns=slice(0, 2)):
    def bend(seen, _true, random):
        seen[..., columns][pick(random, share)] = value
        return seen

    return bend


def copy_truth(share):
    def bend(seen, true, random):
        return np.where(pick(random, share)[..., None] & np.array([1, 1, 0], bool), true, seen)

    return bend


def vary_sigma(spread):
    def bend(seen, true, random):
        return true + (seen - true) * np.exp(spread * random.standard_normal((TRACKS, 1, 1)))

    return bend


def measure_in_degrees(seen, true, _random):
    true[..., 2] *= 180.0 / pi
    seen[..., 2] *= 180.0 / pi
    return seen


@pytest.mark.parametrize("kind", ["white", "student_t"])
@pytest.mark.parametrize(
    ("bend", "names"),
    [
        (turn(pi, 0.05), ["heading: share of errors near 180°"]),
        (turn(pi, 0.01), ["heading: share of errors near 180°"]),
        (turn(-pi / 2, 0.05), ["heading: share of errors near 90°"]),
        (measure_in_degrees, ["heading: share of other errors beyond 45°"]),
        (put(-1000.0, 0.03), ["reported values that are -1000"] * 2),
        (put(0.0, 0.05, slice(0, 1)), ["longitudinal: share of reported values that are 0"]),
        (copy_truth(0.7), ["share of errors that are exactly 0"] * 2),
        (copy_truth(0.05), ["share of errors that are exactly 0"] * 2),
        (vary_sigma(0.5), ["variance of mean z² between tracks"] * 3),
    ],
)
def test_a_cause_is_named_and_no_other(kind, bend, names):
    found = list_causes(draw(bend=bend), kind)
    assert len(found) == len(names)
    for check, name in zip(found, names, strict=True):
        assert name in check.name
        assert not check.holds
        assert check.remedy
        assert not check.interval.low <= check.expected <= check.interval.high


def put_both(share, *places):
    """Sentinels, each in some columns of so many rows."""

    def bend(seen, _true, random):
        for value, columns in places:
            seen[..., columns][pick(random, share)] = value
        return seen

    return bend


ALONG, ACROSS, TURN = slice(0, 1), slice(1, 2), slice(2, 3)


@pytest.mark.parametrize("digits", [None, 2])
@pytest.mark.parametrize(
    ("bend", "named"),
    [
        (put_both(0.05, (-1000.0, ALONG), (999.0, ALONG)), [{-1000, 999}]),
        (put_both(0.05, (-1000.0, ALONG), (999.0, ACROSS)), [{-1000}, {999}]),
        (put_both(0.05, (-1.0, ALONG), (255.0, ALONG)), [{-1, 255}]),
        (put_both(0.05, (-1.0, slice(0, 2)), (255.0, slice(0, 2))), [{-1, 255}] * 2),
        (put_both(0.008, (-1.0, ALONG), (255.0, ALONG)), [{-1, 255}]),
        (put_both(0.05, (0.0, ALONG), (1e6, ALONG), (-1e6, ALONG)), [{0, 1e6, -1e6}]),
        (
            put_both(0.03, *((each, ALONG) for each in (-1, -2, -3, 99, 100))),
            [{-1, -2, -3, 99, 100}],
        ),
        (put_both(0.3, (-1000.0, ALONG), (999.0, ALONG), (255.0, ALONG)), [{-1000, 999, 255}]),
        (put_both(0.05, (-1.0, TURN), (2.25, TURN)), [{-1, 2.25}]),
        (put_both(0.12, (-1.0, TURN), (2.25, TURN)), [{-1, 2.25}]),
    ],
)
def test_every_repeated_far_value_is_named(bend, named, digits):
    found = list_causes(draw(bend=bend, digits=digits))
    values = [
        {float(word) for word in check.name.split(" that are ")[1].split(" or ")} for check in found
    ]
    assert values == named


def test_a_far_value_is_named_beside_copies_of_the_truth():
    def bend(seen, true, random):
        return put(-1000.0, 0.05)(copy_truth(0.7)(seen, true, random), true, random)

    names = [check.name for check in list_causes(draw(bend=bend))]
    assert [name for name in names if "-1000" in name] == [
        "longitudinal: share of reported values that are -1000",
        "lateral: share of reported values that are -1000",
    ]


def test_far_true_values_are_named():
    def bend(seen, true, random):
        true[..., 0][pick(random, 0.02)] = -1000.0
        true[..., 0][pick(random, 0.02)] = 999.0
        return seen

    (check,) = list_causes(draw(bend=bend))
    assert check.name.startswith("longitudinal: share of true values that are ")
    assert {"-1000", "999"} <= set(check.name.split())


def test_more_far_values_than_a_name_lists_are_counted():
    places = [(100.0 * k, ALONG) for k in range(2, 14)]
    (check,) = list_causes(draw(bend=put_both(0.02, *places)))
    assert check.name.endswith("and 4 more")


def be_wrong_about_classes(seen, _true, random):
    """Each vehicle is reported at one of two places in its lane, for some rows at the other."""
    kinds = np.array([20.0, 50.0])
    kind = np.repeat(random.integers(2, size=(TRACKS, 1)), STEPS, axis=1)
    _true[..., 0] = kinds[kind] + 0.3 * random.standard_normal(kind.shape)
    seen[..., 0] = kinds[np.where(pick(random, 0.1), 1 - kind, kind)]
    return seen


def err_for_whole_tracks(seen, _true, random):
    seen[..., :2] += 8.0 * random.standard_normal((TRACKS, 1, 2)) * pick(random, 0.03)[:, :1, None]
    return seen


def err_anywhere(seen, _true, random):
    """Some rows are matched with other vehicles."""
    other = random.uniform(-60.0, 60.0, seen.shape)
    return np.where(pick(random, 0.2)[..., None] & np.array([1, 1, 0], bool), other, seen)


def draw_tails(seen, true, random):
    return true + random.standard_t(2.1, seen.shape) * [0.5, 0.2, 0.02]


def last(seen, true, random):
    errors = random.standard_normal(seen.shape) * [0.5, 0.2, 0.03]
    for step in range(1, STEPS):
        errors[:, step] = 0.98 * errors[:, step - 1] + 0.2 * errors[:, step]
    return true + errors


def stand(seen, true, random):
    """Vehicles that stand, some of them matched with another one that stands, too."""
    true[...] = true[:, :1]
    seen[...] = true + random.standard_normal((TRACKS, 1, 3)) * [0.5, 0.2, 0.03]
    seen[:4, :, 0] += 30.0
    return seen


@pytest.mark.parametrize("digits", [None, 3, 2, 1])
@pytest.mark.parametrize(
    "bend",
    [be_wrong_about_classes, err_for_whole_tracks, err_anywhere, draw_tails, last, stand],
)
def test_no_far_value_is_named_where_none_means_anything(bend, digits):
    for seed in range(4):
        found = list_causes(draw(seed, bend, digits))
        assert not [check.name for check in found if "values that are" in check.name]


@pytest.mark.parametrize("digits", [None, 4, 2])
def test_clean_logs_have_no_cause(digits):
    for seed in range(10):
        assert list_causes(draw(seed, digits=digits)) == []


def test_coarse_digits_are_named():
    (check,) = list_causes(draw(digits=1))
    assert check.name == "heading: share of errors that are exactly 0"
    assert "rounded to 0.1" in check.remedy


def test_causes_replace_remedies_that_guess_others():
    log = draw(bend=turn(pi, 0.05))
    failed = [check for check in check_channels(log, fit(log), ()) if not check.holds]
    assert failed[0].name == "heading: share of errors near 180°"
    others = [check for check in failed[1:] if check.name.startswith("heading")]
    assert {check.remedy for check in others} == {SEE_CAUSE}


def test_a_joint_fit_names_causes_too():
    log = draw(bend=put(-1000.0, 0.03))
    white = CANDIDATES[0]
    best = maximize_likelihood(make_likelihood(white, log.select("longitudinal", "lateral")))
    joint = Fit(white, ("longitudinal", "lateral"), best, ShapeScore(0.0, None))
    names = [check.name for check in check_position(log, joint)]
    assert names[:2] == [
        "longitudinal: share of reported values that are -1000",
        "lateral: share of reported values that are -1000",
    ]


def drive(seed=1, speed_mps=20.0, spread=0.005, *, units=(1.0, 1.0), has_speed=False, share=0.5):
    """A log of vehicles that change lanes, some of them oncoming, with headings in some units."""
    random = np.random.default_rng(seed)
    rows = []
    for n in range(TRACKS):
        speed = speed_mps * random.uniform(0.7, 1.3)
        size_m = min(1.7, 0.07 * speed_mps) if random.uniform() < share else 0.1
        phase, oncoming = random.uniform(0.0, 2.0 * pi), bool(n % 4 == 0 and units == (1.0, 1.0))
        for k in range(80):
            dy = size_m * np.sin(0.1 * k + phase) + 3.5 * (n % 3 - 1)
            heading = np.arcsin(np.clip(size_m * np.cos(0.1 * k + phase) / speed, -1.0, 1.0))
            heading = (pi - heading + pi) % (2.0 * pi) - pi if oncoming else heading
            dx, seen = 10.0 + n + 0.1 * k, heading + spread * random.standard_normal()
            errors = random.standard_normal(2) * [0.5, 0.2]
            others = (
                heading * units[0],
                seen * units[1],
                *([speed, speed + errors[0]] * has_speed),
            )
            rows.append(Row(str(n), 0.1 * k, (dx, dy, dx + errors[0], dy + errors[1]), others))
    return make_log(rows, 0.1, ("heading", "speed") if has_speed else ("heading",))


DEGREES = 180.0 / pi


@pytest.mark.parametrize("has_speed", [False, True])
@pytest.mark.parametrize("speed_mps", [5.0, 12.0, 20.0, 30.0])
def test_small_headings_in_degrees_are_named(speed_mps, has_speed):
    log = drive(spread=0.005, speed_mps=speed_mps, units=(DEGREES, DEGREES), has_speed=has_speed)
    found = list_causes(log)
    (check,) = [each for each in found if each.name.startswith("heading")]
    assert check.name.startswith("heading: ratio of changes of true headings to those of the dir")
    assert "in degrees" in check.remedy


def spread_headings(size_rad, spread_rad, choose=None):
    """True headings that are unrelated to the motion."""

    def bend(seen, true, random):
        true[..., 2] = random.uniform(-size_rad, size_rad, (TRACKS, STEPS))
        if choose:
            true[..., 2] = random.choice(choose, (TRACKS, 1)) + 0.05 * true[..., 2]
        seen[..., 2] = true[..., 2] + spread_rad * random.standard_normal((TRACKS, STEPS))
        return seen

    return bend


def test_headings_that_fill_more_than_a_turn_are_named():
    found = list_causes(draw(bend=spread_headings(4.5, 0.3)))
    assert [check.name for check in found] == [
        "heading: range of reported headings",
        "heading: range of true headings",
    ]


@pytest.mark.parametrize("choose", [[0.0, -pi, pi], [-2.0 * pi, -pi, 0.0, pi], [0.0, pi, pi / 2]])
def test_headings_of_oncoming_and_crossing_vehicles_have_no_cause(choose):
    assert list_causes(draw(bend=spread_headings(1.0, 0.03, choose))) == []


@pytest.mark.parametrize(
    ("units", "words"),
    [((1.0, DEGREES), "reported headings seem"), ((DEGREES, 1.0), "true headings seem")],
)
def test_a_single_column_in_degrees_is_named(units, words):
    found = list_causes(drive(spread=0.002, units=units))
    (check,) = [each for each in found if each.name.startswith("heading")]
    assert "ratio of changes of reported headings to those of true ones" in check.name
    assert words in check.remedy


@pytest.mark.parametrize("has_speed", [False, True])
@pytest.mark.parametrize("spread", [0.001, 0.05, 0.2])
@pytest.mark.parametrize("speed_mps", [3.0, 12.0, 35.0])
def test_headings_in_radians_are_not_taken_as_degrees(speed_mps, spread, has_speed):
    for seed, share in ((1, 0.5), (2, 0.05)):
        log = drive(seed, speed_mps, spread, has_speed=has_speed, share=share)
        assert list_causes(log) == []


def test_a_parameter_on_its_bound_is_named():
    _, report = fit_log(draw(bend=copy_truth(0.7)))
    said = " ".join(report.remarks)
    assert "longitudinal.sigma lies on its bound, 0.0001" in said
    assert "longitudinal.degrees_of_freedom lies on its bound, 2.05" in said
    assert "heading" not in said


@pytest.mark.parametrize("spread", [0.05, 0.3, 0.8])
def test_the_unit_of_large_heading_errors_is_noted(spread):
    _, report = fit_log(drive(spread=spread, share=0.0))
    said = " ".join(report.remarks)
    assert ("Heading errors were read as radians" in said) == (spread > 0.35)
    assert ("rad, is 45°" in said or "rad, is 46°" in said) == (spread == 0.8)


def test_turned_headings_do_not_put_the_unit_in_doubt():
    _, report = fit_log(draw(bend=turn(pi, 0.1)))
    assert "read as radians" not in " ".join(report.remarks)
