"""Real processes to be killed, and a reader of what they leave."""

import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parent))

from made_once import make_once
from stage import Stage


@pytest.fixture(scope="package", autouse=True)
def interpreted() -> Iterator[None]:
    """Has processes interpret the episode loop: compiled, campaigns end before faults happen."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("EIGENFAIL_INTERPRETED", "1")
        yield


@pytest.fixture
def stage(sqlite_template: Path, tmp_path: Path) -> Iterator[Stage]:
    """An empty SQLite database, and whatever is started on it."""
    shutil.copy(sqlite_template, tmp_path / "eigenfail.db")
    stage = Stage(f"sqlite:///{tmp_path / 'eigenfail.db'}", tmp_path)
    yield stage
    stage.end()


@pytest.fixture(scope="session")
def undisturbed(sqlite_template: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The digests of the campaigns of `Stage.launch` on a day on which nothing dies."""
    return make_once(tmp_path_factory, "calm", lambda folder: find_digests(sqlite_template, folder))


def find_digests(sqlite_template: Path, folder: Path) -> dict[str, str]:
    """Run the campaigns of `Stage.launch`, and say what digests they have."""
    shutil.copy(sqlite_template, folder / "eigenfail.db")
    calm = Stage(f"sqlite:///{folder / 'eigenfail.db'}", folder)
    try:
        calm.services()
        calm.worker()
        campaigns = calm.launch()
        found = calm.finish(*campaigns.values())
        assert found.repeated == 0
        return {method: found.digests[campaign] for method, campaign in campaigns.items()}
    finally:
        calm.end()
