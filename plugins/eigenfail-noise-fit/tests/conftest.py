"""What the tests of the plug-in share."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from eigenfail.cli.main import app

PLUGIN = Path(__file__).parents[1]


@pytest.fixture(scope="session")
def benchmark():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(PLUGIN / "benchmarks")
        import noise_fit

        yield noise_fit


@pytest.fixture
def eigenfail():
    """Runs a command; its result has exit_code, stdout and stderr."""

    def run(*words):
        return CliRunner().invoke(app, [str(word) for word in words], prog_name="eigenfail")

    return run
