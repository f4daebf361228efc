"""The keys of hub and worker where Kubernetes puts them: links, readable by a group."""

import pytest
from manifests import built, named

from eigenfail.files import read_private
from eigenfail.wire.keys import read_worker_key
from eigenfail_services.hub.keys import HubKeys, KeyFolder, derive_public_key


def mounted(volume, files, folder):
    """A volume of a secret as the kubelet makes it: data, a link to it, a link for each name."""
    secret = volume["secret"]
    items = secret.get("items") or [{"key": key, "path": key} for key in files]
    data = folder / "..2026_11_22"
    for item in items:
        path = data / item["path"]
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(files[item["key"]])
        path.chmod(item.get("mode", secret["defaultMode"]))
    (folder / "..data").symlink_to(data.name)
    for found in data.iterdir():
        (folder / found.name).symlink_to(f"..data/{found.name}")


def volume_of(manifests, deployment, name):
    volumes = named(manifests, "Deployment", deployment)["spec"]["template"]["spec"]["volumes"]
    return next(volume for volume in volumes if volume["name"] == name)


@pytest.fixture
def made(tmp_path):
    """What `eigenfail worker key create plain --data keys` leaves, by the keys of the secrets."""
    folder, file = tmp_path / "keys", tmp_path / "plain.key"
    KeyFolder(folder).create("plain", file)
    hub, plain = (folder / name for name in ("hub.key", "workers/plain"))
    return {
        "hub.key": hub.read_text(),
        "plain": plain.read_text(),
        "worker.key": file.read_text(),
    }


def test_the_hub_lets_the_worker_in_whose_key_is_in_the_other_secret(made, tmp_path):
    manifests = built("plain-workers")
    for name in ("hub", "worker"):
        (tmp_path / name).mkdir()
    mounted(volume_of(manifests, "services", "hub-keys"), made, tmp_path / "hub")
    worker = {"worker.key": made["worker.key"]}
    mounted(volume_of(manifests, "worker", "key"), worker, tmp_path / "worker")
    key = read_worker_key(read_private(tmp_path / "worker" / "worker.key", ""), "")
    hub = HubKeys(KeyFolder(tmp_path / "hub"))
    assert key.hub == derive_public_key(hub.secret)
    assert hub.list_accepted().get(derive_public_key(key.secret)) == "plain"
