"""benchmarks/performance.md shows what the scripts print, and explains all figures of `make bench`.

docs/performance.md and docs/scale.md state a few of these figures, each with its name.
"""

import json
import re
import subprocess
import sys

import pytest

PAGE = "benchmarks/performance.md"
QUOTING = {"docs/performance.md": 5, "docs/scale.md": 5}
"""Pages that state benchmarks, and how many at least."""

QUOTED = re.compile(r"(\d[\d.]*)(?:\s+\S+)?\s+\(`(\w+)`\)")


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
    script = [sys.executable, "-m", "benchmarks.speed.episode_profile", "3"]
    done = subprocess.run(script, cwd=root, capture_output=True, text=True, check=True)
    printed = done.stdout.splitlines()
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
    script = benchmark("benchmarks.speed.service_profile")
    header, _, *rows = table(page, "service")
    assert cells(header) == list(script.COLUMNS)
    names = [script.BARE, *(name for name, _ in script.PROCESSES.values()), "wall time"]
    assert [cells(row)[0] for row in rows] == names
    assert [cells(row)[2] for row in rows[1:-1]] == [m for _, m in script.PROCESSES.values()]


def test_every_figure_of_the_benchmarks_is_explained_with_its_target(page, root):
    measured = json.loads((root / "benchmarks" / "results" / "latest.json").read_text())
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


@pytest.mark.parametrize("name", QUOTING)
def test_a_figure_in_a_page_of_the_documents_is_the_benchmark_that_it_names(name, root):
    text = (root / name).read_text()
    files = ("latest.json", "volume.json")
    measured = {}
    for file in files:
        measured |= json.loads((root / "benchmarks" / "results" / file).read_text())
    quoted = QUOTED.findall(text)
    assert len(quoted) >= QUOTING[name]
    assert len(quoted) == len(re.findall(r"\(`\w+`\)", text)), "a name without its figure"
    for printed, figure in quoted:
        digits = len(printed.partition(".")[2])
        assert float(printed) == round(measured[figure]["value"], digits), figure


def test_the_planner_takes_more_than_half_of_an_episode_as_the_documents_say(page, root):
    assert "more than half of that is the\nplanner" in (root / "docs/performance.md").read_text()
    rows = {row[0]: row for row in map(cells, table(page, "episode")[2:])}
    parts = ("planner", "quadratic program", "OSQP itself")
    assert sum(float(rows[part][2]) for part in parts) > 0.5 * float(rows["all"][2])


@pytest.mark.parametrize("name", [PAGE, "docs/performance.md"])
def test_the_page_names_files_and_settings_that_exist(name, root):
    for file in re.findall(r"(?:benchmarks|workers)/[\w/.]+\w", (root / name).read_text()):
        assert (root / file).exists(), file


def test_a_part_counts_its_own_time_only(benchmark, monkeypatch):
    profile, now = benchmark("benchmarks.speed.episode_profile"), [0.0]
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
