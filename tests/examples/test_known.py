"""The problems with known failure probability: each truth in a second way, files, campaigns."""

import re
import subprocess
import sys
from importlib import import_module
from math import pi, sqrt
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.interpolate import make_interp_spline
from scipy.stats import chi2, ncx2, norm

from eigenfail.cli.specs import check_plugins, read_spec
from eigenfail.functions import ALLOWED_VARIABLE
from eigenfail.values.episode import learner_seed
from eigenfail.values.learning import LearnerContext
from eigenfail_services.campaigns.rounds import Rounds, run_in_process
from eigenfail_services.campaigns.validation import check_spec
from eigenfail_services.methods.subset import SubsetMethod, SubsetMethodSettings
from eigenfail_workers.engines import make_engine

FOLDER = Path(__file__).parents[2] / "examples" / "known"
SEED = 20
NUMBERS, FEWEST_DRAWS = 8_000_000, 100_000


@pytest.fixture(scope="module")
def known():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "path", [*sys.path, str(FOLDER)])
        yield import_module("known")


def names():
    return sorted(file.stem for file in FOLDER.glob("*.toml"))


def integrate_over_angles(robustness):
    """P of a problem of two numbers: along rays from the origin, the squared radius is chi2(2)."""
    angle = (np.arange(4000) + 0.5) / 4000 * 2.0 * pi
    radius = np.linspace(0.0, 9.0, 401)

    def fails(angle, radius):
        points = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
        return robustness(points.reshape(-1, 1, 2)).reshape(points.shape[:-1]) <= 0.0

    grid = fails(angle[:, None], radius)
    assert not grid[:, 0].any()
    ray, place = np.nonzero(grid[:, 1:] != grid[:, :-1])
    low, high, leaves = radius[place], radius[place + 1], grid[ray, place]
    for _ in range(40):
        middle = (low + high) / 2.0
        before = fails(angle[ray], middle) == leaves
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    return np.sum(np.where(leaves, -1.0, 1.0) * np.exp(-(low**2) / 2.0)) / len(angle)


def follow_walk():
    """P that a walk of 60 steps leaves a band: its density within the band, step by step."""
    reach = 3.6 * sqrt(60.0)
    place, weight = np.polynomial.legendre.leggauss(400)
    place, weight = place * reach, weight * reach
    move = norm.pdf(place[:, None] - place) * weight
    stays = np.ones(len(place))
    for _ in range(59):
        stays = move @ stays
    return 1.0 - (norm.pdf(place) * weight) @ stays


def follow_tracker():
    """P that the error 0.9 e + z passes 9 in 30 steps, where a share of the steps has no z."""
    limit, measured = 9.0, 1.0 - 2.0 * norm.sf(2.0)
    place, weight = np.polynomial.legendre.leggauss(300)
    place, weight = (place + 1.0) / 2.0 * (limit + 16.0) - 16.0, weight / 2.0 * (limit + 16.0)
    start = np.append(place, 0.0)
    move = norm.pdf(place - 0.9 * start[:, None]) * weight
    passes = np.zeros(len(start))
    for _ in range(30):
        without = make_interp_spline(place, passes[:-1], k=5)(np.maximum(0.9 * start, place[0]))
        later = move @ passes[:-1] + norm.sf(limit - 0.9 * start)
        passes = measured * later + (1.0 - measured) * without
    return passes[-1]


def pass_any_plane():
    """P that any of eight numbers with correlation 0.3 passes 3.9, given what they share."""

    def passes(shared):
        beyond = norm.logcdf((3.9 - sqrt(0.3) * shared) / sqrt(0.7))
        return -norm.pdf(shared) * np.expm1(8.0 * beyond)

    return quad(passes, -10.0, 10.0, epsabs=1e-14, limit=200)[0]


def pass_paraboloid():
    """P given the sum of squares of the other 99 numbers."""
    degrees = 99

    def passes(squares):
        reach = 5.0 + (squares - degrees) / sqrt(2.0 * degrees)
        return chi2.pdf(squares, degrees) * norm.sf(reach)

    return quad(passes, 20.0, 300.0, epsabs=1e-14, limit=200)[0]


def pass_any_step(known, draws=100_000):
    """P that a gap, linear in the noise, is 0 at any step: draws given that it is at one of them.

    P = sum of P_t · E[1 / number of steps with a failure] (Owen, Maximov and Chertkov 2019,
    Electronic Journal of Statistics 13, equation 5).
    """
    steps = known.PROBLEMS["following"].steps
    pulses = np.concatenate([np.zeros((1, 2 * steps)), np.eye(2 * steps)])
    gaps = follow_gaps(known, pulses.reshape(-1, steps, 2))
    mean, slope = gaps[0], (gaps[1:] - gaps[0]).T
    spread = np.linalg.norm(slope, axis=1)
    reach, toward = mean / spread, -slope / spread[:, None]
    alone = norm.sf(reach)
    random = np.random.default_rng(SEED)
    step = random.choice(steps, draws, p=alone / alone.sum())
    along = norm.isf(random.uniform(size=draws) * alone[step])
    z = random.standard_normal((draws, 2 * steps))
    z += ((along - (z * toward[step]).sum(axis=1))[:, None]) * toward[step]
    failing = z @ slope.T + mean <= 1e-9
    assert ((known.following(z.reshape(-1, steps, 2)) <= 1e-9) == failing.any(axis=1)).all()
    shares = alone.sum() / failing.sum(axis=1)
    return shares.mean(), shares.std() / sqrt(draws)


def follow_gaps(known, z):
    """The gap at each step, shape (n, steps); the function itself answers the smallest."""
    gap, speed = np.full(len(z), known.DESIRED_GAP), np.zeros(len(z))
    gaps = []
    for step in range(z.shape[1]):
        lead = known.BRAKE_M_S2 if step in known.BRAKE else 0.0
        error = gap - known.DESIRED_GAP + known.GAP_NOISE * z[:, step, 0]
        closing = speed + known.SPEED_NOISE * z[:, step, 1]
        acceleration = known.GAP_GAIN * error + known.SPEED_GAIN * closing
        speed = speed + known.STEP_S * (lead - acceleration)
        gap = gap + known.STEP_S * speed
        gaps.append(gap)
    return np.stack(gaps, axis=1)


PLANES = ("two_corners", "four_branches", "rp22", "rp57", "banana", "metaballs", "rastrigin")
OTHERS = {
    "four_regions": lambda: 1.0 - (norm.cdf(3.0902323) - norm.sf(3.0902323)) ** 2,
    "corner": lambda: norm.sf(2.3263479) ** 2,
    "shell": lambda: chi2.sf(5.277910688521919**2, 6),
    "shell_d40": lambda: chi2.sf(9.058824086786549**2, 40),
    "island": lambda: ncx2.cdf(1.5**2, 4, 4.5**2),
    "series": pass_any_plane,
    "paraboloid": pass_paraboloid,
    "walk": follow_walk,
    "braking": follow_tracker,
}


@pytest.mark.parametrize("name", PLANES)
def test_the_truth_of_two_numbers_is_the_integral_over_angles(known, name):
    problem = known.PROBLEMS[name]
    found = integrate_over_angles(problem.robustness)
    assert found == pytest.approx(problem.probability, rel=3e-4)


@pytest.mark.parametrize("name", OTHERS)
def test_the_truth_is_the_closed_form_or_the_quadrature(known, name):
    assert OTHERS[name]() == pytest.approx(known.PROBLEMS[name].probability, rel=1e-6)


def test_the_truth_of_car_following_is_that_of_the_union_over_its_steps(known):
    found, error = pass_any_step(known)
    assert error < 0.003 * found
    assert abs(found - known.PROBLEMS["following"].probability) < 4.0 * error


@pytest.mark.parametrize("name", names())
def test_plain_draws_fail_as_often_as_is_said(known, name):
    """Draws with a fixed seed; the rarest failures are expected nine times."""
    problem = known.PROBLEMS[name]
    random, failures = np.random.default_rng(SEED), 0
    draws = max(NUMBERS // (2 * problem.steps), FEWEST_DRAWS)
    for _ in range(20):
        z = random.standard_normal((draws // 20, problem.steps, 2))
        failures += np.count_nonzero(problem.robustness(z) <= 0.0)
    expected = draws * problem.probability
    assert expected > 9.0
    assert abs(failures - expected) < 3.5 * sqrt(expected)


def test_each_function_has_a_file_that_tells_its_truth(known, monkeypatch):
    monkeypatch.chdir(FOLDER)
    monkeypatch.setenv(ALLOWED_VARIABLE, "known")
    readme = (FOLDER / "README.md").read_text()
    assert names() == sorted(known.PROBLEMS)
    for name, problem in known.PROBLEMS.items():
        assert getattr(known, name) is problem.robustness
        file = FOLDER / f"{name}.toml"
        (told,) = re.findall(r"^# P = ([\d.e-]+[\d])", file.read_text(), re.MULTILINE)
        assert float(told) == pytest.approx(problem.probability, rel=1e-6)
        spec = read_spec(file)
        check_plugins(spec)
        check_spec(spec)
        assert spec.planner == f"known:{name}"
        assert spec.scenario_parameters == {"steps": problem.steps}
        assert f"eigenfail run {name}.toml" in file.read_text()
        assert f"`{name}`" in readme


@pytest.mark.parametrize("name", ["four_branches", "corner"])
def test_intervals_of_campaigns_from_their_file_hold_the_truth(known, name, monkeypatch):
    monkeypatch.chdir(FOLDER)
    monkeypatch.setenv(ALLOWED_VARIABLE, "known")
    spec = read_spec(FOLDER / f"{name}.toml")
    found = [estimate(spec, episodes=1500, seed=seed) for seed in range(4)]
    truth = known.PROBLEMS[name].probability
    assert sum(one.interval.low < truth < one.interval.high for one in found) >= 3
    assert 0.4 * truth < np.mean([one.probability for one in found]) < 2.5 * truth


def estimate(spec, episodes, seed):
    """What a campaign of `subset` says of P, in the engine that a worker makes for it."""
    steps = spec.scenario_parameters["steps"]
    nothing = np.zeros((0, steps, 2), np.float32)
    context = LearnerContext(learner_seed(seed), episodes, steps, nothing)
    rounds = Rounds(SubsetMethod(context, SubsetMethodSettings()), seed, episodes)
    results = list(run_in_process(rounds, make_engine(spec.setup())))
    assert len(results) <= episodes
    return rounds.estimate()


def check(*words):
    return subprocess.run(
        [sys.executable, "check.py", *words],
        cwd=FOLDER,
        capture_output=True,
        check=False,
        text=True,
    )


def test_the_check_counts_numbers_and_intervals_that_hold():
    done = check("--episodes", "1000", "--seeds", "2", "two_regions")
    assert done.returncode == 0, done.stderr
    row = r"two_regions +1\.100e-03   2 of 2 print a number, mean \d\.\d\d of P, [012] intervals"
    assert re.match(row, done.stdout)


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (["nowhere"], "no such problem: nowhere"),
        (["--method", "magic", "walk"], "'magic' is not known"),
        (["--episodes", "10", "walk"], "10 are fewer"),
    ],
)
def test_wrong_words_are_told(words, problem):
    done = check(*words)
    assert done.returncode == 2
    assert problem in done.stderr
    assert "Traceback" not in done.stderr


def test_a_wrong_number_is_called_wrong(known, monkeypatch):
    monkeypatch.setattr(sys, "path", [*sys.path, str(FOLDER)])
    from check import format_row, is_right

    from eigenfail.values.estimates import Estimate, Interval

    def say(probability, low, high, **more):
        around = Interval(low, high) if low else None
        return Estimate(
            by="subset simulation",
            episodes=9,
            probability=probability,
            cv=0.1,
            interval=around,
            **more,
        )

    assert is_right(say(1e-4, 5e-5, 2e-4), 6e-5)
    assert not is_right(say(1e-4, 5e-5, 2e-4), 4e-5)
    assert not is_right(say(1e-4, 5e-5, 2e-4), 3e-4)
    assert is_right(say(1e-4, None, None, bound="lower"), 3e-4)
    assert not is_right(say(1e-4, None, None, bound="lower"), 5e-5)
    silent = Estimate(by="subset simulation", episodes=9, problem="none")
    assert "1 of 2 print a number, mean 0.50 of P, 0 intervals" in format_row(
        "x", 2e-4, [silent, say(1e-4, 9e-5, 1.1e-4)]
    )
