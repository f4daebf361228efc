"""The manifests: what Kubernetes and KubeRay take, and what the design asks of them."""

import json
import os
from pathlib import Path

import jsonschema
import pytest
import rules
import yaml
from manifests import (
    KUBERNETES,
    NO_CHECKS,
    OVERLAYS,
    built,
    changed,
    example,
    named,
    pods,
    templates,
)
from ray.scripts.scripts import start

kubernetes_validate = pytest.importorskip("kubernetes_validate", reason=NO_CHECKS)

VERSION = "1.37"
KUBERAY = json.loads((Path(__file__).parent / "kuberay.schema.json").read_text())
RULES = (rules.of_pods, rules.of_probes, rules.of_secrets, rules.of_network)


def as_kubernetes_takes_it(manifest):
    """Raises if it does not. It knows no RayCluster: of that, its pods and KubeRay's own fields."""
    if manifest["kind"] != "RayCluster":
        kubernetes_validate.validate(manifest, VERSION, strict=True)
        return
    jsonschema.validate(manifest, KUBERAY)
    for template in templates(manifest):
        pod = {"apiVersion": "v1", "kind": "PodTemplate", "metadata": {"name": "pod"}}
        kubernetes_validate.validate(pod | {"template": template}, VERSION, strict=True)
    kubernetes_validate.validate(autoscaler(manifest), VERSION, strict=True)


def autoscaler(cluster):
    """What the operator makes of the options: a container."""
    options = cluster["spec"]["autoscalerOptions"]
    fields = ("imagePullPolicy", "resources", "securityContext", "volumeMounts")
    container = {"name": "autoscaler"} | {field: options[field] for field in fields}
    spec = {"containers": [container]}
    return {"apiVersion": "v1", "kind": "Pod", "metadata": {"name": "pod"}, "spec": spec}


def test_kubernetes_and_kuberay_know_every_field(overlay):
    for manifest in overlay:
        as_kubernetes_takes_it(manifest)


@pytest.mark.parametrize(
    ("whose", "path", "value"),
    [
        ("Deployment controller", "spec.template.spec.contaners", []),
        ("NetworkPolicy ray", "spec.ingres", []),
        ("RayCluster eigenfail", "spec.enableIntreeAutoscaling", True),
        ("RayCluster eigenfail", "spec.authOptions.mode", "tokens"),
        ("RayCluster eigenfail", "spec.autoscalerOptions.securityContext.readOnlyRoot", True),
        ("RayCluster eigenfail", "spec.workerGroupSpecs.0.rayStartParams.num-cpus", 1),
        ("RayCluster eigenfail", "spec.headGroupSpec.template.spec.container", []),
    ],
)
def test_a_field_that_is_none_is_found(trial, whose, path, value):
    broken = changed(trial, *whose.split(), path, value)
    wrong = (kubernetes_validate.ValidationError, jsonschema.ValidationError)
    with pytest.raises(wrong):
        as_kubernetes_takes_it(named(broken, *whose.split()))


@pytest.mark.parametrize("rule", RULES)
def test_the_rules_of_the_house_are_kept(overlay, rule):
    assert rule(overlay) == []


SPEC = "spec.template.spec"
WRONG = [
    (rules.of_pods, "Deployment controller", f"{SPEC}.containers.0.image", "eigenfail:latest"),
    (rules.of_pods, "Deployment services", f"{SPEC}.containers.0.resources.limits.memory", None),
    (rules.of_pods, "Deployment services", f"{SPEC}.containers.0.securityContext", {}),
    (rules.of_pods, "Deployment services", f"{SPEC}.securityContext.runAsNonRoot", False),
    (rules.of_pods, "Deployment services", f"{SPEC}.automountServiceAccountToken", True),
    (rules.of_pods, "Deployment controller", f"{SPEC}.volumes.0.emptyDir", {}),
    (rules.of_pods, "RayCluster eigenfail", f"spec.headGroupSpec.{SPEC[5:]}.hostNetwork", True),
    (rules.of_probes, "Deployment services", f"{SPEC}.containers.0.livenessProbe", None),
    (rules.of_secrets, "Deployment controller", f"{SPEC}.containers.0.env.1.valueFrom", None),
    (rules.of_network, "Deployment services", f"{SPEC}.containers.0.ports.0.containerPort", 8449),
    (rules.of_network, "Service services", "spec.ports.0.port", 8442),
    (rules.of_network, "Service controller", "spec.selector", {"app.kubernetes.io/name": "api"}),
    (rules.of_network, "NetworkPolicy services", "spec.ingress.0.ports.0.port", 8440),
    (rules.of_network, "NetworkPolicy worker", "spec.podSelector.matchLabels", {"a": "b"}),
    (rules.of_network, "NetworkPolicy nothing", "spec.policyTypes", ["Ingress"]),
]


@pytest.mark.parametrize(("rule", "whose", "path", "value"), WRONG)
def test_what_breaks_a_rule_is_found(trial, rule, whose, path, value):
    assert rule(changed(trial, *whose.split(), path, value)) != []


def test_the_cluster_scales_to_nothing_and_asks_for_a_token(trial):
    spec = named(trial, "RayCluster", "eigenfail")["spec"]
    (group,) = spec["workerGroupSpecs"]
    asked = named(trial, "Deployment", "services")["spec"]["template"]["spec"]["containers"][0]
    assert spec["enableInTreeAutoscaling"] is True
    assert spec["authOptions"]["mode"] == "token"
    assert spec["headGroupSpec"]["rayStartParams"]["include-dashboard"] == "false"
    assert (group["minReplicas"], group["rayStartParams"]["num-cpus"]) == (0, "1")
    assert f"--max-workers={group['maxReplicas']}" in asked["args"]


def test_services_and_cluster_have_the_same_token(trial):
    secret = named(trial, "RayCluster", "eigenfail")["spec"]["authOptions"]["secretName"]
    spec = named(trial, "Deployment", "services")["spec"]["template"]["spec"]
    (volume,) = (v for v in spec["volumes"] if v["name"] == "ray-token")
    assert volume["secret"]["secretName"] == secret
    (path,) = (
        e["value"] for e in spec["containers"][0]["env"] if e["name"] == "RAY_AUTH_TOKEN_PATH"
    )
    assert path == "/run/eigenfail-ray/auth_token"  # the key that the operator looks for


def test_the_cluster_runs_the_ray_that_is_pinned_with_options_that_it_has(trial):
    spec = named(trial, "RayCluster", "eigenfail")["spec"]
    pinned = (KUBERNETES.parents[1] / "constraints.txt").read_text().splitlines()
    assert f"ray=={spec['rayVersion']} \\" in pinned
    known = {option.removeprefix("--") for parameter in start.params for option in parameter.opts}
    for group in (spec["headGroupSpec"], *spec["workerGroupSpecs"]):
        assert group["rayStartParams"].keys() <= known


def test_what_the_operator_hands_on_as_a_flag_is_one(trial):
    """It writes `true` as `--option`, and `false` not at all, but for two options."""
    spec = named(trial, "RayCluster", "eigenfail")["spec"]
    flags = {p.opts[0].removeprefix("--") for p in start.params if p.is_flag}
    for group in (spec["headGroupSpec"], *spec["workerGroupSpecs"]):
        words = {k: v for k, v in group["rayStartParams"].items() if v in {"true", "false"}}
        assert {k for k, v in words.items() if v == "true"} <= flags
        assert {k for k, v in words.items() if v == "false"} <= {"include-dashboard", "log-color"}


def test_another_registry_reaches_every_container_of_ours(tmp_path):
    trial = os.path.relpath(KUBERNETES / "overlays" / "trial", tmp_path)
    images = [{"name": "eigenfail", "newName": "registry.example/eigenfail"}]
    (tmp_path / "kustomization.yaml").write_text(
        yaml.safe_dump({"resources": [trial], "images": images})
    )
    found = {c["image"] for pod in pods(built(tmp_path)) for c in pod.containers()}
    assert found == {"registry.example/eigenfail:0.1.0", "postgres:18.4-bookworm"}


def test_the_overlays_are_those_of_the_documents():
    text = (KUBERNETES.parents[1] / "docs" / "deployment.md").read_text()
    assert [name for name in OVERLAYS if f"`{name}`" not in text] == []


def test_the_example_of_ci_is_a_job_that_keeps_to_the_rules():
    job = example("gate_job.yaml")
    kubernetes_validate.validate(job, VERSION, strict=True)
    assert rules.of_pods([job]) == []
    assert pods([job])[0].labels["eigenfail/client"] == "true"


def test_a_learner_with_a_gpu_has_one_and_the_image_for_it():
    services = named(built("gpu-learner"), "Deployment", "services")["spec"]["template"]["spec"]
    (container,) = services["containers"]
    assert container["image"] == "eigenfail:0.1.0-cuda"
    assert container["resources"]["limits"]["nvidia.com/gpu"] == "1"
    assert services["tolerations"][0]["key"] == "nvidia.com/gpu"


def test_plain_workers_need_no_ray():
    kinds = {manifest["kind"] for manifest in built("plain-workers")}
    assert "HorizontalPodAutoscaler" in kinds
    assert "RayCluster" not in kinds
