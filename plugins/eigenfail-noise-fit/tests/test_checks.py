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


CAUSES = ("near ", "exactly 0", "reported values that are", "between tracks", "beyond 45°")


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


def test_a_parameter_on_its_bound_is_named():
    _, report = fit_log(draw(bend=copy_truth(0.7)))
    said = " ".join(report.remarks)
    assert "longitudinal.sigma lies on its bound, 0.0001" in said
    assert "longitudinal.degrees_of_freedom lies on its bound, 2.05" in said
    assert "heading" not in said
