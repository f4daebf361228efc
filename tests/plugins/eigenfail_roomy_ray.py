"""The process of Ray's driver, of a Ray that has room for everybody: real pipes, and no Ray."""

from eigenfail_services.campaigns import ray_process
from eigenfail_services.campaigns.ray_link import ClusterStatus


class Cluster:
    """One machine."""

    def __init__(self, _address: object, _most: int, _folder: str) -> None:
        pass

    def machines(self) -> int:
        return 1

    def close(self) -> None:
        pass


class Workers:
    """All that are wanted have their places."""

    def __init__(self, _hub: str, _key: object) -> None:
        self._names: tuple[str, ...] = ()

    def want(self, names: tuple[str, ...]) -> None:
        self._names = names

    def standing(self, machines: int) -> ClusterStatus:
        return ClusterStatus(machines, self._names)

    def dismiss(self) -> None:
        pass


if __name__ == "__main__":
    ray_process.RayCluster, ray_process.RayWorkers = Cluster, Workers
    ray_process.main()
