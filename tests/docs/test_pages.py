"""Every code block of every page runs, in the order of the page, in one shell for each page.

typed_pages.py says what differs from what a reader types. Blocks that cannot run here stand in
`NOT_RUN`, each with its reason.
"""

from pathlib import Path

import deadlines
import msgspec
import pytest
from typed_pages import (
    BLOCK,
    EXECUTED,
    SHOWN,
    blocks,
    check,
    commands,
    demo_in,
    reason,
    seen,
    shell,
    type_in,
)

pytestmark = [pytest.mark.service, pytest.mark.timeout(2 * deadlines.TEST_S)]

ROOT = Path(__file__).parents[2]
PAGES = (
    "README.md",
    *(
        f"{folder}/{page.name}"
        for folder in ("docs", "benchmarks")
        for page in sorted((ROOT / folder).glob("*.md"))
    ),
)
INSTALLS = "It installs packages from a registry or an operating system."
CONTAINERS = "It needs Docker or a cluster."
SUITE = "It is what runs these tests, or runs them for minutes."
MEASURES = "It measures for many minutes; its results are claims."

NOT_RUN = {
    "make setup": INSTALLS,
    ".venv/bin/eigenfail up": "It is a service; tests/browser/test_first_ten_minutes.py has one.",
    "make demo": "It takes minutes; tests/docs/test_pages.py runs the same searches, smaller.",
    "make ": SUITE,
    "EIGENFAIL_REQUIRE_PROOFS": SUITE,
    "eigenfail db vacuum": "The service must be stopped: tests/services/store/test_vacuum.py.",
    "eigenfail episode replay 3/115": "It replays an episode of a database from a pipeline.",
    "cp deploy/": CONTAINERS,
    "docker ": CONTAINERS,
    "pip install '.[": INSTALLS,
    "pip install libsumo": INSTALLS,
    "cat *.log | jq": "It needs jq and the logs of a cluster.",
    "OTEL_": "It needs a collector of traces.",
    ".venv/bin/python -m benchmarks": MEASURES,
}
OTHERWISE = {
    "docs/deployment.md": f"{CONTAINERS} tests/deploy checks its files and commands.",
    "docs/security.md": "It turns authentication on for good: tests/sdk/cli/test_key.py.",
    "docs/contributing.md": f"{SUITE} Its Python shows a mark: tests/docs/fault_table.py.",
    "docs/faults.md": f"{SUITE} It is the soak.",
    "docs/world.md": "Its TOML is a part of a campaign: test_the_importance_is_accepted.",
    "docs/bridge_examples.md": "tests/examples/bridge builds and runs these bridges.",
    "docs/foreign_stacks.md": "tests/examples/bridge runs these bridges.",
    "docs/fix_a_planner.md": "tests/sdk/cli/gate/test_story.py runs its commands in order.",
    "docs/releases.md": "It compares versions of a planner: tests/sdk/cli/test_release.py.",
    "docs/triage.md": "tests/sdk/cli/test_triage.py runs its commands and its Python.",
    "docs/sdk.md": "tests/sdk/cli/test_sdk_page.py runs its blocks in order, in one process.",
}
"""Pages whose blocks run in another test, or not at all."""


OWN = {
    "docs/quickstart.md": (
        r"[1-9]\d* of \d+ eigenfailures reproduced a failure",
        r"(1 distinct mode|(\d+|No) distinct modes)\b",
        r"Digest|digest",
    ),
    "docs/own_planner.md": (r"1/\d+ +collision", r"my_planner"),
    "docs/own_scenario.md": (r"1/\d+ +collision", r"queue_end"),
    "docs/own_method.md": (r"1/\d+ +collision", r"hill_climb"),
    "docs/own_simulator.md": (r"1/\d+ +collision", r"10 passed"),
    "docs/any_function.md": (r"1/\d+ +collision", r"failures in 400 calls"),
    "docs/plugins.md": (r"budget +Count the episodes", r"29,956 episodes with", r"4 passed"),
    "docs/bridge.md": (r"minimal", r"1/\d+ +collision"),
}
"""Pages that start a service of their own, or need none, and what is to be seen in the end."""

AFTER_DEMO = {
    "README.md": (
        r"2/\d+ +collision",
        r"[1-9]\d* of \d+ eigenfailures reproduced",
    ),
    "docs/episodes.md": (r"2/\d+ +collision", r"\] m²/s²"),
    "docs/analysis.md": (r"mode",),
    "docs/suites.md": (r"Planners on cut-in",),
    "docs/gate.md": (r"v1",),
    "docs/rest.md": (r"first try",),
    "docs/cli.md": (r"monte_carlo",),
    "docs/planner.md": (),
    "docs/noise.md": (),
    "docs/requirements.md": (),
    "docs/reliability.md": (r"sound|holds|checked",),
    "docs/scale.md": (r"episodes lost their noise",),
}
"""Pages that speak of the campaigns of `make demo`, typed one after the other on one service."""


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    methods = ("monte_carlo", 20), ("ast", 150), ("difs", 100), ("held", 20)
    with demo_in(tmp_path_factory.mktemp("demo"), *methods) as here:
        yield here


@pytest.mark.parametrize("page", OWN)
def test_a_page_with_a_service_of_its_own_runs(page, tmp_path):
    with shell(tmp_path) as here:
        type_in(page, here, NOT_RUN)
        seen(here.output, OWN[page])


@pytest.mark.parametrize("page", AFTER_DEMO)
def test_a_page_on_the_campaigns_of_the_demo_runs(page, demo, tmp_path):
    with shell(tmp_path) as here:
        here.join(demo)
        type_in(page, here, NOT_RUN)
        seen(here.output, AFTER_DEMO[page])


@pytest.mark.timeout(deadlines.TEST_S)
def test_a_command_that_hangs_is_ended_with_its_shell(tmp_path, monkeypatch):
    monkeypatch.setattr("typed_pages.COMMAND_WITHIN_S", 0.5)
    with shell(tmp_path) as here, pytest.raises(AssertionError, match="took too long"):
        here.type("sleep 300; true")


def test_the_importance_is_accepted():
    ((language, block),) = blocks("docs/world.md")
    assert language == "toml"
    check(block)
    with pytest.raises(msgspec.ValidationError):
        check(block.replace('kind = "measure"', 'kind = "measured"'))


def test_every_page_with_blocks_is_typed_or_says_why_not():
    executed = {page for page in PAGES if blocks(page)}
    rest = executed - OWN.keys() - AFTER_DEMO.keys() - OTHERWISE.keys()
    runnable = {
        line
        for page in rest
        for language, block in blocks(page)
        for line in (commands(block) if language == "sh" else [page])
        if reason(line, NOT_RUN) is None
    }
    assert runnable == set()


def test_every_reason_is_needed():
    lines = [
        line
        for page in PAGES
        for language, block in blocks(page)
        if language == "sh"
        for line in commands(block)
    ]
    assert [start for start in NOT_RUN if not any(line.startswith(start) for line in lines)] == []
    assert OTHERWISE.keys() <= set(PAGES)


def test_every_language_of_a_block_is_known():
    text = "".join((ROOT / page).read_text() for page in PAGES)
    assert {name for name, _ in BLOCK.findall(text)} <= EXECUTED | SHOWN.keys()
