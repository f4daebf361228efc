"""What processes of learners and analyses may take: options, and the environment behind them."""

import resource
import subprocess
import sys
from collections.abc import Iterator
from math import inf

import psutil
import pytest

from eigenfail_services import __main__ as services
from eigenfail_services import bounds
from eigenfail_services.bounds import SettingBounds


def test_without_a_word_it_is_an_hour_and_half_of_the_memory(monkeypatch) -> None:
    for variable in (bounds.LEARNER_LIMIT, bounds.ANALYSIS_LIMIT, bounds.LEARNER_MEMORY):
        monkeypatch.delenv(variable, raising=False)
    given = services.parse([])
    half = bounds.half_of_the_memory_mib()
    assert (given.learner_limit, given.analysis_limit, given.learner_memory) == (3600, 3600, half)
    assert bounds.LEAST_MIB <= half <= max(bounds.LEAST_MIB, psutil.virtual_memory().total / 2**21)


def test_options_outdo_the_environment(monkeypatch) -> None:
    monkeypatch.setenv(bounds.LEARNER_LIMIT, "60")
    monkeypatch.setenv(bounds.ANALYSIS_LIMIT, "inf")
    monkeypatch.setenv(bounds.LEARNER_MEMORY, "700")
    given = services.parse(["--learner-limit", "2.5"])
    assert (given.learner_limit, given.analysis_limit, given.learner_memory) == (2.5, inf, 700)


@pytest.mark.parametrize("text", ["0", "-1", "nan", "an hour", ""])
def test_what_is_no_limit_is_refused(text, capsys) -> None:
    with pytest.raises(SystemExit) as ended:
        services.parse(["--learner-limit", text])
    assert ended.value.code == 2
    assert "is not a number above 0" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("written", "half"), [("3221225472\n", 1536.0), ("268435456\n", 1024.0), ("max\n", None)]
)
def test_a_container_has_what_its_limit_leaves(tmp_path, written, half) -> None:
    limit = tmp_path / "memory.max"
    limit.write_text(written)
    of_the_machine = bounds.half_of_the_memory_mib(tmp_path / "none")
    assert bounds.half_of_the_memory_mib(limit) == (half or of_the_machine)


@pytest.fixture
def sleeper() -> Iterator[int]:
    """The number of a process that has 64 MiB at most."""
    with subprocess.Popen(["sleep", "1000"]) as process:
        resource.prlimit(process.pid, resource.RLIMIT_DATA, (2**26, 2**26))
        yield process.pid
        process.kill()


@pytest.mark.skipif(sys.platform != "linux", reason="other kernels have no such limits")
@pytest.mark.parametrize(("memory_mib", "most_mib"), [(128.0, 64), (32.0, 32), (inf, 64)])
def test_a_lower_limit_of_the_services_own_stays(sleeper, memory_mib, most_mib) -> None:
    SettingBounds(inf, memory_mib).confine(sleeper)
    assert resource.prlimit(sleeper, resource.RLIMIT_DATA) == (most_mib * 2**20,) * 2


@pytest.mark.skipif(sys.platform != "linux", reason="other kernels have no such limits")
def test_a_process_that_may_not_be_confined_ends_nothing(monkeypatch) -> None:
    def refused(*_words) -> tuple[int, int]:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(bounds.resource, "prlimit", refused)
    SettingBounds(inf, 64.0).confine(1)


def test_how_many_campaigns_run_at_a_time(monkeypatch) -> None:
    monkeypatch.delenv(bounds.CAMPAIGNS, raising=False)
    monkeypatch.setattr(bounds, "memory_mib", lambda *_: 3_000.0)
    assert services.parse([]).campaigns == bounds.SOME_CAMPAIGNS
    monkeypatch.setenv(bounds.CAMPAIGNS, "6")
    assert services.parse([]).campaigns == 6
    assert services.parse(["--campaigns", "10"]).campaigns == 10
    monkeypatch.delenv(bounds.CAMPAIGNS)
    monkeypatch.setattr(bounds, "memory_mib", lambda *_: 700.0)
    assert services.parse([]).campaigns == 2


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        *((text, "is not an integer above 0") for text in ("0", "-1", "1.5", "four", "", "²")),
        ("11", "at most 10: a learner takes 300 MiB"),
        ("9" * 5_000, "are too many here"),
    ],
)
def test_more_learners_than_memory_are_refused(text, problem, monkeypatch, capsys) -> None:
    monkeypatch.setattr(bounds, "memory_mib", lambda *_: 3_000.0)
    with pytest.raises(SystemExit) as ended:
        services.parse([f"--campaigns={text}"])
    assert ended.value.code == 2
    assert problem in capsys.readouterr().err
