"""The container recipe and the compose file: linted, and they say what the design asks of them."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from manifests import NO_CHECKS
from starlette.testclient import TestClient

from eigenfail.addresses import TRUST_VARIABLE
from eigenfail.errors import InvalidValue
from eigenfail.values.access import KeyRequest, Scope
from eigenfail.wire.keys import WORKER_KEY_VARIABLE
from eigenfail_api.__main__ import read_settings
from eigenfail_api.app import create_app
from eigenfail_services import __main__ as program
from eigenfail_services.access import make_key
from eigenfail_services.hub import transport
from eigenfail_services.store.store import open_store

DEPLOY = Path(__file__).parents[2] / "deploy"
BIN = Path(sys.executable).parent
PROGRAMS = {"eigenfail", "eigenfail_api", "eigenfail_services", "eigenfail_workers"}


@pytest.fixture(scope="module")
def ours(services):
    return {name: service for name, service in services.items() if name != "postgres"}


def lint(*command):
    if not Path(command[0]).exists():
        pytest.skip(NO_CHECKS)
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_the_recipe_is_clean():
    done = lint(BIN / "hadolint", DEPLOY / "Dockerfile")
    assert done.returncode == 0, done.stdout


def test_the_linter_sees_a_bad_recipe(tmp_path):
    bad = tmp_path / "Dockerfile"
    bad.write_text("FROM python:latest\nRUN cd /x && sudo pip install torch\n")
    assert lint(BIN / "hadolint", bad).returncode != 0


def test_the_compose_file_follows_its_schema():
    schema = ("--builtin-schema", "vendor.compose-spec")
    done = lint(BIN / "check-jsonschema", *schema, DEPLOY / "compose.yaml")
    assert done.returncode == 0, done.stdout


def test_the_schema_refuses_a_wrong_compose_file(tmp_path):
    bad = tmp_path / "compose.yaml"
    bad.write_text("services:\n  one:\n    imge: x\n")
    assert lint(BIN / "check-jsonschema", "--builtin-schema", "vendor.compose-spec", bad).returncode


def test_every_target_runs_as_nobody_in_particular_and_asks_for_its_health():
    stages = re.split(r"^FROM ", (DEPLOY / "Dockerfile").read_text(), flags=re.MULTILINE)[1:]
    by_name = {stage.split("\n")[0].split(" AS ")[1]: stage for stage in stages}
    assert "HEALTHCHECK" in by_name["run"]
    for target in ("worker", "everything"):
        assert by_name[target].startswith("run AS")
        assert "USER 10001:10001" in by_name[target].splitlines()


def test_the_image_installs_nothing_whose_hash_is_not_locked():
    """Besides the wheels that it builds itself, which are installed alone and from files."""
    recipe = (DEPLOY / "Dockerfile").read_text().replace("\\\n", " ")
    installs = re.findall(r"\bpip install .*", recipe)
    ours = [line for line in installs if " /wheel/" in line]
    # Only the last stage, which has the server's packages, has plug-ins.
    names = [line.rpartition("/wheel/")[2] for line in ours]
    assert names == ["eigenfail-*.whl", "eigenfail-*.whl", "*.whl"]
    assert all("--no-deps" in line for line in ours)
    others = [line for line in installs if line not in ours]
    assert all("--require-hashes" in line for line in others)
    locks = [re.findall(r"--requirement \"?(\S+?)\"?(?:\s|$)", line) for line in others]
    assert locks == [
        ["locks/build.txt"],
        ["locks/worker.txt"],
        ["locks/torch_${TORCH}.txt", "locks/server.txt"],
        ["locks/compiler.txt"],
    ]
    (build,) = re.findall(r"\bpip wheel .*", recipe)
    assert {"--no-deps", "--no-index", "--no-build-isolation"} <= set(build.split())


def test_everything_the_recipe_copies_is_let_through_and_exists():
    copied = set()
    for line in (DEPLOY / "Dockerfile").read_text().splitlines():
        if line.startswith("COPY ") and "--from" not in line:
            copied |= set(line.split()[1:-1])
    let_through = {
        line[1:]
        for line in (DEPLOY / "Dockerfile.dockerignore").read_text().splitlines()
        if line.startswith("!")
    }
    assert copied == let_through
    assert all((DEPLOY.parent / path).exists() for path in copied)


def test_only_the_controller_is_published_and_on_loopback_alone(services):
    published = {name: service["ports"] for name, service in services.items() if "ports" in service}
    assert published == {"controller": ["127.0.0.1:8440:8440"]}


def test_only_the_controller_leaves_the_private_network(services):
    networks = {name: service["networks"] for name, service in services.items()}
    assert networks.pop("controller") == ["private", "edge"]
    assert all(where == ["private"] for where in networks.values())


def test_every_role_runs_a_program_of_ours_with_few_rights(ours):
    for service in ours.values():
        program = service["command"][0]
        assert program in PROGRAMS or service["entrypoint"][0] in {"ray", "sh"}
        assert service["read_only"] is True
        assert service["cap_drop"] == ["ALL"]


def test_the_hub_asks_for_keys_that_are_made_before_it_starts(services, monkeypatch):
    hub, keys, worker = (services[name] for name in ("services", "keys", "plain-worker"))
    assert TRUST_VARIABLE not in hub["environment"]
    folder = keys["environment"][transport.KEYS_VARIABLE]
    monkeypatch.setenv(transport.KEYS_VARIABLE, hub["environment"][transport.KEYS_VARIABLE])
    assert str(program.parse(hub["command"][1:]).hub_keys) == folder
    assert all(f"hub-keys:{folder}" in service["volumes"][0] for service in (hub, keys))
    assert keys["command"][:-1] == ["eigenfail", "worker", "key", "create", "compose"]
    assert keys["command"][-1] == f"--file={worker['environment'][WORKER_KEY_VARIABLE]}"
    assert hub["depends_on"]["keys"] == {"condition": "service_completed_successfully"}


ANOTHER = {"name": "mine", "scope": "admin"}


@pytest.fixture
def controller(services, monkeypatch):
    """The controller with the variables of the compose file, on a store in memory; its store."""
    for name, value in services["controller"]["environment"].items():
        if name not in {"EIGENFAIL_DATABASE", "PGPASSWORD"}:
            monkeypatch.setenv(name, value)
    store = open_store("memory://")
    yield store, read_settings(services["controller"]["command"][1:])
    store.close()


def test_the_controller_starts_once_an_administrator_has_a_key(services, controller):
    store, settings = controller
    with pytest.raises(InvalidValue, match="no administrator has a valid key"):
        create_app(store, settings)
    made = {"condition": "service_completed_successfully"}
    assert services["controller"]["depends_on"]["admin-key"] == made
    assert services["admin-key"]["depends_on"]["migrate"] == made


def test_neither_a_page_nor_a_container_makes_a_key_without_one(controller):
    store, settings = controller
    token = make_key(store, KeyRequest("compose", Scope.ADMIN)).token
    with TestClient(create_app(store, settings), base_url="http://x") as client:

        def make(host, **headers):
            sent = {"Host": host, **headers}
            return client.post("/api/v1/keys", json=ANOTHER, headers=sent).status_code

        assert make("evil.example:8440", Origin="http://evil.example:8440") == 400
        assert make("127.0.0.1:8440", Origin="http://evil.example:8440") == 403
        assert make("controller:8440") == make("127.0.0.1:8440") == 401
        assert store.keys.page(10).items[0].name == "compose"
        shown = {"Authorization": f"Bearer {token}"}
        assert make("controller:8440", **shown) == make("127.0.0.1:8440", **shown) == 201
        assert client.get("/readyz", headers={"Host": "127.0.0.1:8440"}).status_code == 200


def test_nobody_holds_more_of_the_keys_than_it_needs(services):
    holders = {
        volume: {
            name: mounted.endswith(":ro")
            for name, service in services.items()
            for mounted in service.get("volumes", ())
            if mounted.startswith(f"{volume}:")
        }
        for volume in ("admin-key", "hub-keys", "worker-key", "ray-token")
    }
    assert holders["admin-key"] == {"admin-key": False}
    assert holders["hub-keys"] == {"keys": False, "services": True}
    assert holders["worker-key"] == {"keys": False, "plain-worker": True}
    nodes = dict.fromkeys(("ray-head", "services", "worker"), True)
    assert holders["ray-token"] == {"ray-token": False} | nodes
    made = (DEPLOY / "Dockerfile").read_text()
    folders = "/var/lib/eigenfail-hub /var/lib/eigenfail-worker /var/lib/eigenfail-ray"
    assert f"--mode=0700 \\\n        {folders} \\\n        /var/lib/eigenfail-admin\n" in made


def test_memory_for_temporary_files_is_bounded(ours):
    assert all(service["tmpfs"] == ["/tmp:size=512m"] for service in ours.values())


def test_whatever_stays_up_has_a_health_check(services):
    lasting = {name for name, service in services.items() if service["restart"] != "no"}
    assert lasting >= {"postgres", "controller", "services", "ray-head", "worker", "plain-worker"}
    assert all("healthcheck" in services[name] for name in lasting)


def test_no_password_stands_in_the_file(services):
    text = (DEPLOY / "compose.yaml").read_text()
    assert set(re.findall(r"PASSWORD: (\S+)", text)) == {"${POSTGRES_PASSWORD:?set"}
    assert not re.search(r"://[^\s/]*:[^\s/]*@", text)
    assert (DEPLOY / ".env.example").read_text().strip().endswith("POSTGRES_PASSWORD=")


@pytest.mark.parametrize("name", ["worker", "plain-worker"])
def test_workers_can_be_scaled(services, name):
    assert "container_name" not in services[name]
    assert "ports" not in services[name]


def test_modules_of_functions_reach_whoever_has_to_know_them(services):
    variables = {name: one.get("environment", {}) for name, one in services.items()}
    knowing = {name for name, its in variables.items() if "EIGENFAIL_FUNCTIONS" in its}
    assert knowing == {"controller", "services", "worker", "plain-worker"}
    text = (DEPLOY / "compose.yaml").read_text()
    for name in ("EIGENFAIL_FUNCTIONS", "EIGENFAIL_HOSTS", "EIGENFAIL_PROXIES"):
        assert f"{name}: '${{{name}:-" in text


def test_the_controller_answers_under_its_names_and_believes_no_proxy(controller):
    _, settings = controller
    assert settings.names == ("localhost", "127.0.0.1", "controller")
    assert settings.proxies == ()
