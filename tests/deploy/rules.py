"""What every pod of ours has to keep to, and how the network has to fit: problems, in words."""

from collections.abc import Iterator

from manifests import Manifest, Pod, named, pods

IMAGES = {"eigenfail:0.1.0", "eigenfail:0.1.0-cuda", "postgres:18.4-bookworm"}
LASTING = {"Deployment", "StatefulSet", "RayCluster"}
CONTAINER = {
    "allowPrivilegeEscalation": False,
    "readOnlyRootFilesystem": True,
    "runAsNonRoot": True,
    "capabilities": {"drop": ["ALL"]},
}
SECRET = ("PASSWORD", "DATABASE", "_TOKEN", "_KEY")
TOKEN_FOR = {"ray-head"}
"""The autoscaler beside Ray's head asks Kubernetes for pods; nobody else has anything to ask."""


def of_pods(manifests: list[Manifest]) -> list[str]:
    """What is wrong with the pods."""
    return [problem for pod in pods(manifests) for problem in _of_pod(pod)]


def _of_pod(pod: Pod) -> Iterator[str]:
    name, spec = pod.labels["app.kubernetes.io/name"], pod.spec
    context = spec["securityContext"]
    if not (context.get("runAsNonRoot") and context.get("runAsUser", 0) > 0):
        yield f"{name}: may run as root"
    if context.get("seccompProfile") != {"type": "RuntimeDefault"}:
        yield f"{name}: all system calls"
    if spec.get("automountServiceAccountToken") is not (name in TOKEN_FOR):
        yield f"{name}: the token of Kubernetes"
    yield from (f"{name}: {field}" for field in ("hostNetwork", "hostPID") if spec.get(field))
    for volume in spec["volumes"]:
        if "emptyDir" in volume and "sizeLimit" not in volume["emptyDir"]:
            yield f"{name}: {volume['name']} may fill the node"
    for container in pod.containers():
        yield from (f"{name}: {problem}" for problem in _of_container(container))


def _of_container(container: Manifest) -> Iterator[str]:
    if container["image"] not in IMAGES:
        yield f"image {container['image']}"
    for field, wanted in CONTAINER.items():
        if container["securityContext"].get(field) != wanted:
            yield f"{field} is not {wanted}"
    for kind in ("requests", "limits"):
        for what in ("cpu", "memory", "ephemeral-storage"):
            if what not in container["resources"].get(kind, {}):
                yield f"no {kind} of {what}"


def of_probes(manifests: list[Manifest]) -> list[str]:
    """Containers that stay up, and of which nobody would know that they do not work."""
    return [
        f"{container['name']}: no {probe}"
        for pod in pods([m for m in manifests if m["kind"] in LASTING])
        for container in pod.spec["containers"]
        for probe in ("livenessProbe", "readinessProbe")
        if probe not in container
    ]


def of_secrets(manifests: list[Manifest]) -> list[str]:
    """Secrets that stand in a manifest, and variables that hold one without its being a secret."""
    found = [m["metadata"]["name"] for m in manifests if m["kind"] in {"Secret", "ConfigMap"}]
    for pod in pods(manifests):
        for container in pod.containers():
            found += [
                variable["name"]
                for variable in container.get("env", ())
                if variable["name"].endswith(SECRET) and "valueFrom" not in variable
            ]
    return found


def of_network(manifests: list[Manifest]) -> list[str]:
    """Services without an opening, openings of no service, and labels that nobody has."""
    services = [m for m in manifests if m["kind"] == "Service"]
    policies = [m for m in manifests if m["kind"] == "NetworkPolicy"]
    return [
        *(problem for service in services for problem in _of_service(service, manifests, policies)),
        *(problem for policy in policies for problem in _of_policy(policy, manifests)),
        *_default(policies),
    ]


def _default(policies: list[Manifest]) -> Iterator[str]:
    closed = named(policies, "NetworkPolicy", "nothing")["spec"]
    if closed != {"podSelector": {}, "policyTypes": ["Ingress", "Egress"]}:
        yield "not closed by default"


def _of_service(
    service: Manifest, manifests: list[Manifest], policies: list[Manifest]
) -> Iterator[str]:
    name, selector = service["metadata"]["name"], service["spec"]["selector"]
    behind = [pod for pod in pods(manifests) if selector.items() <= pod.labels.items()]
    if not behind:
        yield f"{name}: nobody behind it"
    for port in service["spec"]["ports"]:
        if port["port"] not in {_port(pod, port["targetPort"]) for pod in behind}:
            yield f"{name}: {port['port']} is not where its pods listen"
        if port["port"] not in _open(policies, selector):
            yield f"{name}: {port['port']} is closed"


def _port(pod: Pod, name: str) -> int | None:
    ports = (port for container in pod.spec["containers"] for port in container.get("ports", ()))
    return next((port["containerPort"] for port in ports if port["name"] == name), None)


def _open(policies: list[Manifest], selector: dict[str, str]) -> set[int]:
    return {
        port["port"]
        for policy in policies
        if policy["spec"]["podSelector"].get("matchLabels") == selector
        for rule in policy["spec"].get("ingress", ())
        for port in rule.get("ports", ())
    }


def _of_policy(policy: Manifest, manifests: list[Manifest]) -> Iterator[str]:
    """Every selector meets a pod, but for those of clients, which are others'."""
    name, spec = policy["metadata"]["name"], policy["spec"]
    peers = [
        peer["podSelector"]
        for side, direction in (("ingress", "from"), ("egress", "to"))
        for rule in spec.get(side, ())
        for peer in rule.get(direction, ())
        if "podSelector" in peer
    ]
    for selector in (spec["podSelector"], *peers):
        labels = selector.get("matchLabels", {})
        met = any(labels.items() <= pod.labels.items() for pod in pods(manifests))
        if not met and "eigenfail/client" not in labels:
            yield f"{name}: nobody has {labels}"
