from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def benchmark():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(Path(__file__).parents[3] / "benchmarks")
        import noise_fit

        yield noise_fit
