"""Dashboard and alerts: PromQL that parses, on figures that exist, with labels that they have."""

import json
import re
from pathlib import Path

import pytest
import yaml
from manifests import NO_CHECKS
from prometheus_client import CollectorRegistry
from starlette.testclient import TestClient

from eigenfail_api.app import create_app
from eigenfail_api.settings import ApiSettings
from eigenfail_services.hub.metrics import CampaignLoad, HubStatus, Metrics
from eigenfail_services.observability import VARIABLE
from eigenfail_services.store.store import open_store

FOLDER = Path(__file__).parents[2] / "deploy" / "observability"
OF_PROMETHEUS = {"up", "process_resident_memory_bytes"}
GIVEN = {"job", "instance", "le"}
VARIABLES = {"$__rate_interval": "5m"}
RULES = yaml.safe_load((FOLDER / "alerts.yaml").read_text())["groups"][0]["rules"]
PANELS = json.loads((FOLDER / "grafana.json").read_text())["panels"]


def expressions():
    yield from (rule["expr"] for rule in RULES)
    yield from (target["expr"] for panel in PANELS for target in panel["targets"])


def parsed(expression):
    for name, value in VARIABLES.items():
        expression = expression.replace(name, value)
    return pytest.importorskip("promql_parser", reason=NO_CHECKS).parse(expression)


@pytest.fixture(scope="module")
def labels():
    """The labels of each series of both processes."""
    metrics = Metrics(CollectorRegistry())
    metrics.status = HubStatus({1: CampaignLoad()}, 1)
    app = create_app(open_store("memory://"), ApiSettings())
    with TestClient(app, base_url="http://127.0.0.1") as client:
        client.get("/healthz")
    found = {}
    for registry in (metrics.registry, app.state.registry):
        for family in registry.collect():
            names = labelled(family)
            found |= {name + end: names for name in [family.name] for end in ENDS[family.type]}
    return found


ENDS = {
    "counter": ["_total"],
    "gauge": [""],
    "histogram": ["_bucket", "_sum", "_count"],
}
OF_FAMILY = {
    "eigenfail_campaigns": {"state"},
    "eigenfail_episodes": {"end"},
    "eigenfail_failures": {"method"},
    "eigenfail_instance_hours": {"method"},
    "eigenfail_cost_usd": {"method"},
    "eigenfail_results": {"verdict"},
    "eigenfail_learners_lost": {"kind"},
    "eigenfail_http_requests": {"method", "route", "status"},
}


def labelled(family):
    seen = {name for sample in family.samples for name in sample.labels}
    return seen | OF_FAMILY.get(family.name, set())


@pytest.mark.parametrize("expression", [*expressions()])
def test_an_expression_asks_for_what_there_is(expression, labels):
    parsed(expression)
    text = re.sub(r'"[^"]*"', '""', expression)
    asked = set(re.findall(r"\b(?:eigenfail|process)_\w+|\bup\b", text))
    assert asked
    assert asked - OF_PROMETHEUS <= set(labels)
    groups = re.findall(r"(?:by|on) ?\(([^)]*)\)|\{([^}]*)\}", text)
    named = {word for pair in groups for word in re.findall(r"\w+", " ".join(pair))}
    assert named <= GIVEN.union(*(labels[name] for name in asked - OF_PROMETHEUS))


def test_a_wrong_expression_would_be_seen():
    with pytest.raises(ValueError, match="parenthesis"):
        parsed("sum(rate(eigenfail_results_total[5m])")


def test_every_alert_says_what_is_wrong():
    assert len({rule["alert"] for rule in RULES}) == len(RULES)
    for rule in RULES:
        assert rule["labels"]["severity"] in {"page", "ticket"}
        assert rule["annotations"]["summary"].endswith(".")


def test_panels_do_not_lie_on_each_other():
    cells = [
        (x, y)
        for panel in PANELS
        for at in [panel["gridPos"]]
        for x in range(at["x"], at["x"] + at["w"])
        for y in range(at["y"], at["y"] + at["h"])
    ]
    assert len(cells) == len(set(cells))
    assert max(x for x, _ in cells) < 24
    assert len({panel["id"] for panel in PANELS}) == len(PANELS)


def test_every_figure_is_on_the_dashboard_or_in_an_alert(labels):
    shown = "\n".join(expressions())
    families = {re.sub("_(total|bucket|sum|count)$", "", name) for name in labels}
    assert {name for name in families if name not in shown} <= {"eigenfail_instance_hours"}


def test_what_is_scraped_is_where_the_services_are_told_to_listen():
    jobs = yaml.safe_load((FOLDER / "prometheus.yaml").read_text())["scrape_configs"]
    names = {job["job_name"] for job in jobs}
    assert names == {"eigenfail-controller", "eigenfail-services"}
    assert VARIABLE in (FOLDER / "prometheus.yaml").read_text()
