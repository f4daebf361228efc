"""docs/performance.md shows what the scripts print, and explains every figure of `make bench`."""

import json
import re
import subprocess
import sys

import pytest

PAGE = "docs/performance.md"


@pytest.fixture(scope="module")
def page(root):
    return (root / PAGE).read_text()


def table(page, name):
    return page.split(f"<!-- {name} -->")[1].split(f"<!-- /{name} -->")[0].strip().splitlines()


def cells(line):
    return [cell.strip() for cell in line.strip().strip("|").split("|")]


def without_numbers(line):
    return re.sub(r"[\d.]+", "#", line)


def test_the_table_of_an_episode_is_what_the_script_prints(page, root):
    script = [sys.executable, root / "benchmarks" / "episode_profile.py", "3"]
    printed = subprocess.run(script, capture_output=True, text=True, check=True).stdout.splitlines()
    shown = table(page, "episode")
    assert [*map(without_numbers, shown)] == [*map(without_numbers, printed)]
    calls = {row[0]: row[1] for row in map(cells, printed[2:-1])}
    assert float(calls["quadratic program"]) == pytest.approx(1.0, abs=0.02)
    assert float(calls["OSQP itself"]) == pytest.approx(1.0, abs=0.02)


def test_the_shares_make_a_whole(page):
    rows = [cells(line) for line in table(page, "episode")[2:]]
    *parts, whole = [float(row[2]) for row in rows]
    assert sum(parts) == pytest.approx(whole, rel=0.02)
    assert sum(int(row[3].rstrip("%")) for row in rows[:-1]) == pytest.approx(100, abs=4)


def test_the_table_of_the_service_has_the_scripts_rows(page, benchmark):
    script = benchmark("service_profile")
    header, _, *rows = table(page, "service")
    assert cells(header) == list(script.COLUMNS)
    names = [script.BARE, *(name for name, _ in script.PROCESSES.values()), "wall time"]
    assert [cells(row)[0] for row in rows] == names
    assert [cells(row)[2] for row in rows[1:-1]] == [m for _, m in script.PROCESSES.values()]


def test_every_figure_of_the_benchmarks_is_explained_with_its_target(page, root):
    measured = json.loads((root / "benchmarks" / "latest.json").read_text())
    explained = {}
    for line in page.splitlines():
        if line.startswith("| `"):
            each, targets, now, _ = cells(line)
            names = re.findall(r"`(\w+)`", each)
            words = [word.strip() for word in targets.split(",")]
            explained |= dict(zip(names, words, strict=True))
            for name, printed in zip(names, now.split(","), strict=True):
                digits = len(printed.partition(".")[2])
                assert float(printed) == round(measured[name]["value"], digits), name
    assert explained == {name: figure.get("target", "") for name, figure in measured.items()}


def test_the_page_names_files_and_settings_that_exist(page, root):
    for name in re.findall(r"(?:benchmarks|workers)/[\w/.]+\w", page):
        assert (root / name).exists(), name


def test_a_part_counts_its_own_time_only(benchmark, monkeypatch):
    profile, now = benchmark("episode_profile"), [0.0]
    monkeypatch.setattr(profile.time, "perf_counter", lambda: now[0])
    clock = profile.Clock()

    def busy(seconds):
        now[0] += seconds

    def outer():
        busy(1.0)
        clock.run("inner", busy, 4.0)
        clock.run("inner", busy, 2.0)
        busy(0.5)

    clock.run("outer", outer)
    assert clock.own_s == {"inner": 6.0, "outer": 1.5, profile.OSQP: 0.0}
    assert clock.calls == {"inner": 2, "outer": 1, profile.OSQP: 0}
