"""Numbers of workers: which of them go together, and what the services are told."""

import math
import os

import pytest
from typer.testing import CliRunner

from eigenfail.cli.main import app
from eigenfail.errors import InvalidValue
from eigenfail.hosting.service import Span, make_span

CORES = os.cpu_count() or 1


@pytest.mark.parametrize(
    ("given", "span"),
    [
        ((None, None, None, None), Span(CORES, CORES)),
        ((3, None, None, None), Span(3, 3)),
        ((0, None, None, None), Span(0, 0)),
        ((None, None, 8, None), Span(0, 8, 60.0)),
        ((None, 2, 8, 5.0), Span(2, 8, 5.0)),
        ((None, None, 0, None), Span(0, 0)),
    ],
)
def test_a_number_stays_and_a_range_follows_the_work(given, span) -> None:
    assert make_span(*given) == span


@pytest.mark.parametrize(
    ("given", "problem"),
    [
        ((None, 2, None, None), "--min-workers: requires automatic scaling, which is off."),
        ((None, None, None, 2.0), "--idle-s: requires automatic scaling, which is off."),
        ((2, None, 3, None), "--workers: sets a fixed number"),
        ((None, 4, 3, None), "--min-workers: 4 is not between 0 and"),
        ((None, -1, 3, None), "--min-workers: -1 is not between 0 and"),
        ((None, None, -1, None), "--min-workers: 0 is not between 0 and --max-workers, which is"),
        ((-1, None, None, None), "--workers: -1 is below 0"),
        ((None, None, 3, 0.0), "--idle-s: 0 is not above 0"),
        ((None, None, 3, math.nan), "--idle-s: nan is not above 0"),
    ],
)
def test_what_does_not_go_together_is_refused_by_name(given, problem) -> None:
    with pytest.raises(InvalidValue, match=problem):
        make_span(*given)


@pytest.mark.parametrize("option", ["--min-workers=1", "--max-workers=2", "--idle-s=5"])
def test_workers_that_nobody_starts_are_not_scaled(option, tmp_path) -> None:
    from eigenfail_services.__main__ import parse
    from eigenfail_services.options import create_launcher

    problem = f"{option.partition('=')[0]}: scales workers, and --launcher none starts none."
    with pytest.raises(InvalidValue, match=problem):
        create_launcher(parse(["--launcher", "none", option]))
    up = ["up", "--data", str(tmp_path / "data"), "--launcher", "none", option]
    done = CliRunner().invoke(app, up)
    assert (done.exit_code, problem in done.stderr) == (2, True)
    assert not (tmp_path / "data").exists()


@pytest.mark.parametrize("span", [Span(2, 2), Span(0, 0), Span(0, 8, 5.0), Span(2, 3)])
def test_the_services_read_what_they_are_told(span) -> None:
    from eigenfail_services.__main__ import parse

    told = parse([*span.options()])
    assert make_span(told.workers, told.min_workers, told.max_workers, told.idle_s) == span
