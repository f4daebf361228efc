"""The plug-in's document: every method has its part, and its links lead to files."""

from pathlib import Path

import pytest

from eigenfail.cli.specs import check_plugins, read_spec
from eigenfail_services.campaigns.validation import check_spec

PLUGIN = Path(__file__).parents[1]
TEXT = (PLUGIN / "README.md").read_text()


@pytest.mark.parametrize("method", ["annealing", "chains", "go_explore", "mixture_ce", "optuna"])
def test_every_method_has_its_part_with_its_limits(method):
    part = TEXT.split(f"\n## `{method}`: ")[1].split("\n## ")[0]
    assert f"`{method}` gives no estimate of the probability" in part


def test_its_links_lead_to_files():
    links = [part.partition(")")[0] for part in TEXT.split("](")[1:]]
    files = [link.partition("#")[0] for link in links if not link.startswith(("http", "#"))]
    assert files
    assert [file for file in files if not (PLUGIN / file).exists()] == []


def test_the_example_can_be_launched():
    spec = read_spec(PLUGIN / "examples" / "chains.toml")
    check_plugins(spec)
    assert check_spec(spec).method.name == "chains"
