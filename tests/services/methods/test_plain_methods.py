"""Monte Carlo and replay, and what loading any method costs."""

import subprocess
import sys

import numpy as np
import pytest

from eigenfail import plugins
from eigenfail.errors import InvalidValue
from eigenfail.settings import read_settings
from eigenfail.values.episode import PriorSource
from eigenfail.values.learning import LearnerContext
from eigenfail_services.methods.monte_carlo import MonteCarlo
from eigenfail_services.methods.replay import Replay

TRAJECTORIES = np.arange(3 * 4 * 2, dtype=np.float32).reshape(3, 4, 2)


def replay(trajectories=TRAJECTORIES, **settings):
    context = LearnerContext(0, 100, 4, trajectories)
    return Replay(context, read_settings(Replay.Settings, settings, "settings"))


def test_monte_carlo_proposes_rounds_of_its_size():
    learner = MonteCarlo(LearnerContext(0, 250, 4, TRAJECTORIES), MonteCarlo.Settings())
    assert learner.propose(250).sources == (PriorSource(),) * 100
    assert learner.lookahead >= 3


def test_replay_injects_all_in_order_as_often_as_told_and_ends():
    learner = replay(repeats=2, round_size=4)
    proposed = []
    while sources := learner.propose(100).sources:
        proposed.extend(source.z for source in sources)
    np.testing.assert_array_equal(proposed, np.concatenate([TRAJECTORIES, TRAJECTORIES]))


def test_replay_of_nothing_is_refused_with_a_remedy():
    with pytest.raises(InvalidValue, match=r"no noise trajectory.*Name an analysis"):
        replay(TRAJECTORIES[:0])


@pytest.mark.parametrize(
    ("method", "setting", "value"),
    [
        ("ast", "tau", 0.0),
        ("ast", "tau", float("nan")),
        ("ast", "hidden", []),
        ("ast", "amplitude", -1),
        ("ast", "trainer", "magic"),
        ("ast", "reward", "curiosity"),
        ("cem", "elite_share", 1.0),
        ("cem", "min_std", 1.5),
        ("cem", "max_std", 0.5),
        ("cem", "max_mean", float("inf")),
        ("cem", "batch", 1),
        ("difs", "quantile", 1.0),
        ("difs", "device", "tpu"),
        ("minimal", "episode", -1),
        ("minimal", "mode", 0),
        ("monte_carlo", "round_size", 0),
        ("replay", "analysis", 0),
        ("replay", "what", []),
        ("replay", "what", ["centre"]),
        ("subset", "samples", 19),
        ("subset", "level_share", 0.6),
        ("subset", "acceptance", float("nan")),
        ("subset", "runs", 0),
    ],
)
def test_a_setting_outside_its_bounds_is_refused_by_name(method, setting, value):
    kind = plugins.load(plugins.METHODS, method).Settings
    with pytest.raises(InvalidValue, match=f"settings.{setting}"):
        read_settings(kind, {setting: value}, "settings")


def test_methods_load_without_torch():
    code = (
        "import sys; from eigenfail import plugins;"
        "[plugins.load(plugins.METHODS, name) for name in plugins.names(plugins.METHODS)];"
        "sys.exit('torch' in sys.modules or 'gymnasium' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
