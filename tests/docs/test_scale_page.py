"""benchmarks/scale.md shows what the model of scale makes of the figures of `make bench`."""

import re
from importlib import import_module

import pytest

PAGE = "benchmarks/scale.md"


@pytest.fixture(scope="module")
def page(root):
    return (root / PAGE).read_text()


def test_the_table_of_workers_is_what_the_model_says_now(page, benchmark):
    scale = benchmark("benchmarks.speed.scale")
    begin, end = scale.MARKS
    shown = page.split(begin)[1].split(end)[0].strip().splitlines()
    assert shown == [*scale.table(scale.latest())]


def test_every_measured_crew_is_in_the_table(page, benchmark):
    scale = benchmark("benchmarks.speed.scale")
    columns = benchmark("benchmarks.speed.scale_table").HEADS
    place = columns.index("measured /s")
    rows = [line.split("|")[1:-1] for line in page.splitlines() if line.startswith("| `")]
    measured = sum(bool(row[place].strip()) for row in rows if len(row) == len(columns))
    assert measured == sum(map(len, scale.MEASURED.values()))


def test_how_far_a_method_looks_ahead_is_what_the_method_says(benchmark):
    table = benchmark("benchmarks.speed.scale_table")
    cases = benchmark("benchmarks.speed.learner_cost").CASES
    methods = import_module("eigenfail.methods")
    for name, case in cases.items():
        method = methods.describe_method(case.method)
        sizes = method.find_round_sizes(method.read_settings(case.settings, ""), case.episodes)
        ahead = method.count_rounds_ahead(case.parallel, sizes.later)
        assert ahead == table.LOOKAHEAD[name], name


def test_the_model_and_the_hub_have_the_same_bounds(benchmark):
    parts = benchmark("benchmarks.speed.scale_parts")
    commits = import_module("eigenfail_services.hub.commits")
    server = import_module("eigenfail_services.hub.server")
    assert (parts.GROUP_S, parts.GROUP) == (commits.MAX_WAIT_S, commits.MAX_RESULTS)
    assert parts.TURN == server.MESSAGES_PER_TURN


@pytest.mark.parametrize("name", [PAGE, "docs/scale.md"])
def test_the_page_names_files_that_exist(name, root):
    for file in re.findall(r"(?:benchmarks|tests)/[\w/.]+\w", (root / name).read_text()):
        assert (root / file).exists(), file
