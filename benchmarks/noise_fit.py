"""Figures: whether `eigenfail noise fit` finds the models that logs were drawn from.

Logs of `TRACKS` tracks are drawn from disturbance models whose parameters are drawn, too. `covered`
is the share of the planted parameters that lie within their 95 % intervals, `shape` how often the
planted shape is chosen, `false_alarms` how often a check fails although the model is right, and
`misfits_found` how often one fails on logs of errors that no model describes. `python
benchmarks/noise_fit.py` prints them.
"""

from collections.abc import Callable, Iterator, Sequence
from math import nan

import numpy as np
from crew import Crew, crew
from figures import Figure
from numpy.typing import NDArray
from samples import COMMAND, count_share, share

from eigenfail.values import Conversion, Correlated, DisturbanceModel, HeavyTailed, White
from eigenfail_services.noise_fit.checks import check_fit
from eigenfail_services.noise_fit.fitting import (
    Fit,
    Parameter,
    choose_fit,
    find_parameters,
    fit_shapes,
)
from eigenfail_services.noise_fit.sensor_log import Row, SensorLog, make_log

LOGS, TRACKS = 100, 60
STEP_S = 0.1
SHORTEST, LONGEST = 40, 160
MISSED = 0.02

Array = NDArray[np.float64]


def draw_model(random: np.random.Generator, kind: int) -> DisturbanceModel:
    """Draw a disturbance model: white, ar1 and student_t in turn."""
    shapes = (
        White(),
        Correlated(*random.uniform(0.2, 0.95, 2).tolist()),
        HeavyTailed(float(random.uniform(3.0, 8.0))),
    )
    return DisturbanceModel(
        longitudinal_slope=float(random.uniform(0.005, 0.05)),
        longitudinal_base_m=float(random.uniform(0.2, 2.0)),
        lateral_slope=float(random.uniform(0.005, 0.1)),
        lateral_base_m=float(random.uniform(0.05, 0.5)),
        shape=shapes[kind % len(shapes)],
    )


Bend = Callable[[Array, Array, Array], Array]
"""Errors [m] from those of the model, the true positions [m] and their rates [m/s]; all (n, 2)."""


def draw_log(
    model: DisturbanceModel, random: np.random.Generator, bend: Bend | None = None
) -> SensorLog:
    """Draw a log from a model, or of errors that are bent afterwards."""
    rows: list[Row] = []
    for number in range(TRACKS):
        true, rate = draw_course(random)
        errors = draw_errors(model, true, random)
        if bend is not None:
            errors = bend(errors, true, rate)
        seen = np.where(random.uniform(size=(len(true), 1)) < MISSED, nan, true + errors)
        begins_s = float(random.uniform(0.0, 100.0))
        rows += [
            Row(f"{number}", begins_s + STEP_S * i, (*true[i].tolist(), *seen[i].tolist()))
            for i in range(len(true))
        ]
    return make_log(rows, STEP_S)


def draw_course(random: np.random.Generator) -> tuple[Array, Array]:
    """Draw true positions of a vehicle from the ego [m], and their rates [m/s], shape (n, 2)."""
    n = int(random.integers(SHORTEST, LONGEST))
    time_s = STEP_S * np.arange(n)
    speed = np.array([random.uniform(-8.0, 3.0), random.uniform(-0.3, 0.3)])
    begin = np.array([random.uniform(20.0, 90.0), random.choice([-3.5, 0.0, 3.5])])
    return begin + speed * time_s[:, None], np.broadcast_to(speed, (n, 2))


def draw_errors(model: DisturbanceModel, true: Array, random: np.random.Generator) -> Array:
    """Draw the errors of a model at true positions, both of shape (n, 2). [m]"""
    conversion = Conversion(model.shape)
    slopes = np.array([model.longitudinal_slope, model.lateral_slope])
    bases = np.array([model.longitudinal_base_m, model.lateral_base_m])
    sigmas = slopes * np.abs(true) + bases
    drawn = random.standard_normal(true.shape)
    return np.array(
        [
            conversion.inject((z[0], z[1]), (sigma[0], sigma[1]))
            for z, sigma in zip(drawn.tolist(), sigmas.tolist(), strict=True)
        ]
    )


BENDS: dict[str, Bend] = {
    "a bias of half a sigma": lambda errors, _true, _rate: errors + 0.5 * errors.std(axis=0),
    "clocks that are 0.3 s apart": lambda errors, _true, rate: errors - 0.3 * rate,
    "sigma by the square of the distance": lambda errors, true, _rate: (
        errors * (0.3 + np.square(true[:, :1] / 50.0))
    ),
    "three in a hundred errors five times as large": lambda errors, _true, _rate: (
        np.where((np.arange(len(errors)) % 33 == 0)[:, None], 5.0, 1.0) * errors
    ),
    "an offset of each track": lambda errors, true, _rate: (
        errors + errors.std(axis=0) * np.sign(np.sin(1e3 * true[0]))
    ),
}
"""What is done to the errors of a model, by name."""


def judge_log(seed: int) -> tuple[list[bool], bool, bool]:
    """Return which parameters are covered, whether the shape is right, whether a check fails."""
    random = np.random.default_rng([seed, 1])
    model = draw_model(random, seed)
    log = draw_log(model, random)
    best = choose_fit(fit_shapes(log))
    is_right = type(best.model.shape) is type(model.shape)
    covered = list_covered(model, find_parameters(best, log)) if is_right else []
    return covered, is_right, has_alarm(log, best)


def list_covered(model: DisturbanceModel, found: Sequence[Parameter]) -> list[bool]:
    """Return for each parameter whether its interval holds the planted value."""
    return [
        one.interval.low <= find_parameter(model, one.name) <= one.interval.high for one in found
    ]


def find_parameter(model: DisturbanceModel, name: str) -> float:
    """Return a parameter of the model, or of its shape."""
    return float(getattr(model, name) if hasattr(model, name) else getattr(model.shape, name))


def judge_bent_log(seed: int, name: str) -> bool:
    """Return whether a check fails on a log of bent errors."""
    random = np.random.default_rng([seed, 2])
    log = draw_log(draw_model(random, seed), random, BENDS[name])
    return has_alarm(log, choose_fit(fit_shapes(log)))


def has_alarm(log: SensorLog, fit: Fit) -> bool:
    """Whether a check does not hold."""
    return any(not check.holds for check in check_fit(log, fit))


def find_figures(crew: Crew, seed: int) -> Iterator[tuple[str, Figure]]:
    """The figures of all logs."""
    judged = crew.each(judge_log, range(seed, seed + LOGS))
    covered = [one for log, _, _ in judged for one in log]
    yield (
        "fit.covered",
        Figure(
            value=sum(covered) / len(covered),
            unit="share",
            n=len(covered),
            command=COMMAND,
            note=f"of the planted parameters, in {LOGS} logs of {TRACKS} tracks",
        ),
    )
    yield "fit.shape", share([right for _, right, _ in judged])
    yield "fit.false_alarms", share([alarm for _, _, alarm in judged])
    names = [name for name in BENDS for _ in range(LOGS // len(BENDS))]
    found = crew.each(judge_bent_log, range(seed, seed + len(names)), names)
    missed = sorted({name for name, alarm in zip(names, found, strict=True) if not alarm})
    note = (
        f"as many logs each with {', '.join(BENDS)}; not always found: {', '.join(missed) or '-'}"
    )
    yield "fit.misfits_found", count_share(found, note)


if __name__ == "__main__":
    with crew() as everybody:
        for name, figure in find_figures(everybody, 20_261_122):
            print(f"{name} {figure.value:.3f} ({figure.n}): {figure.note}")
