"""What is in the manifests: objects, their pods, the containers of these."""

import copy
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import yaml

DEPLOY = Path(__file__).parents[2] / "deploy"
KUBERNETES = DEPLOY / "kubernetes"
OVERLAYS = sorted(folder.name for folder in (KUBERNETES / "overlays").iterdir())
KUBECTL = Path(sys.executable).parent / "kubectl"

NO_CHECKS = "the extra deploy-checks is not installed: see docs/contributing.md"

Manifest = dict[str, Any]


@cache
def text_of(overlay: str | Path) -> str:
    """What `kubectl apply --kustomize` would send; a path is taken as it is."""
    if not KUBECTL.exists():
        pytest.skip(NO_CHECKS, allow_module_level=True)
    folder = KUBERNETES / "overlays" / overlay
    return subprocess.run(
        [KUBECTL, "kustomize", folder], capture_output=True, text=True, check=True
    ).stdout


def built(overlay: str | Path) -> list[Manifest]:
    """The objects of an overlay."""
    return list(yaml.safe_load_all(text_of(overlay)))


def example(name: str) -> Manifest:
    """An example's one object."""
    return yaml.safe_load((KUBERNETES / "examples" / name).read_text())


class Pod(NamedTuple):
    """The template of pods, and whose it is."""

    owner: str
    labels: dict[str, str]
    spec: Manifest

    def containers(self) -> Iterator[Manifest]:
        """All of them, those that come first as well."""
        yield from self.spec.get("initContainers", ())
        yield from self.spec["containers"]


def templates(manifest: Manifest) -> list[Manifest]:
    """The templates of pods in an object."""
    if manifest["kind"] == "RayCluster":
        spec = manifest["spec"]
        return [group["template"] for group in (spec["headGroupSpec"], *spec["workerGroupSpecs"])]
    template = manifest.get("spec", {}).get("template")
    return [template] if template else []


def pods(manifests: list[Manifest]) -> list[Pod]:
    """Those that the objects make."""
    return [
        Pod(manifest["metadata"]["name"], template["metadata"]["labels"], template["spec"])
        for manifest in manifests
        for template in templates(manifest)
    ]


def named(manifests: list[Manifest], kind: str, name: str) -> Manifest:
    """The object of that kind and name."""
    (found,) = (m for m in manifests if (m["kind"], m["metadata"]["name"]) == (kind, name))
    return found


def changed(
    manifests: list[Manifest], kind: str, name: str, path: str, value: Any
) -> list[Manifest]:
    """A copy in which one field, `spec.template.spec.containers.0.image`, is another or gone."""
    copied = copy.deepcopy(manifests)
    place: Any = named(copied, kind, name)
    *way, last = (int(step) if step.isdecimal() else step for step in path.split("."))
    for step in way:
        place = place[step]
    if value is None:
        del place[last]
    else:
        place[last] = value
    return copied
