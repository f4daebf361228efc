"""`go_explore`: returns, which noise a cell keeps, how cells are chosen, and what is found."""

import numpy as np
import pytest

from eigenfail.errors import LearnerFailed, ProtocolError
from eigenfail.settings import read_settings
from eigenfail.testing.learner import Corridor, ToyEngine
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import EpisodeTask, Importance, episode_seed
from eigenfail.values.learning import LearnerContext
from eigenfail_searches.go_explore import START, Cell, GoExplore, LevelScale
from eigenfail_services.methods import archive
from eigenfail_workers.engine import Engine

CORRIDOR = Corridor(steps=40, gain=0.1, wall=1.6)
STEPS = 100
"""Steps of an episode of `lead_brake`."""


def make_learner(corridor=CORRIDOR, seed=1, **settings):
    nothing = np.zeros((0, corridor.steps, corridor.channels), np.float32)
    given = read_settings(GoExplore.Settings, settings, "settings")
    return GoExplore(LearnerContext(seed, 1000, corridor.steps, nothing), given)


def play(learner, rounds, corridor=CORRIDOR, engine=None):
    """Return the cells returned to, the noise and the results of each episode."""
    engine = engine or ToyEngine(corridor)
    cells, noise, found = [], [], []
    for _ in range(rounds):
        sources = learner.propose(1000).sources
        cells += [one.cell for one in learner._open]
        noise += [source.z for source in sources]
        tasks = [
            EpisodeTask(index, episode_seed(0, index), source)
            for index, source in enumerate(sources, len(found))
        ]
        results = list(engine.run(tasks))
        learner.observe(results)
        found += results
    return cells, np.stack(noise), found


@pytest.mark.parametrize("channels", [1, 2, 5])
@pytest.mark.parametrize(("steps", "hold"), [(25, 10), (7, 10), (25, 1)])
def test_a_value_is_held_for_the_steps_of_the_setting(steps, hold, channels) -> None:
    corridor = Corridor(steps=steps, sigma=(1.0,) * channels)
    _, noise, _ = play(make_learner(corridor, hold=hold, round_size=50), 2, corridor)
    assert noise.shape == (100, steps, channels)
    changes = np.diff(noise, axis=1).any(axis=(0, 2))
    assert set(np.flatnonzero(changes) + 1) == set(range(hold, steps, hold))


def test_a_return_repeats_the_course_of_an_earlier_episode_up_to_its_cell() -> None:
    learner = make_learner(hold=5)
    scale = LevelScale(learner._settings.level_ratio)
    cells, noise, found = play(learner, 12)
    returned = 0
    for number, (cell, result) in enumerate(zip(cells, found, strict=True)):
        if cell == START:
            continue
        steps = 5 * cell.decision
        earlier = noise[: number - number % 20, :steps]
        same = [i for i, z in enumerate(earlier) if np.array_equal(z, noise[number, :steps])]
        assert same
        assert not np.array_equal(noise[same[0]], noise[number])
        assert np.array_equal(found[same[0]].importance[:steps], result.importance[:steps])
        assert scale.find_level(float(result.importance[steps - 1])) == cell.level
        returned += 1
    assert returned > 100


def test_a_return_leads_to_the_same_state_of_the_simulator() -> None:
    spec = CampaignSpec(name="n", method="go_explore", episodes=24, scenario="lead_brake")
    learner = make_learner(Corridor(steps=STEPS), hold=5, round_size=12)
    cells, noise, found = play(learner, 2, engine=Engine(spec.setup()))
    returns = [(i, 5 * cell.decision) for i, cell in enumerate(cells) if cell != START]
    assert len(returns) > 6
    for number, steps in returns:
        same = [i for i in range(12) if np.array_equal(noise[i, :steps], noise[number, :steps])]
        one, other = (found[i].importance[:steps].tolist() for i in (same[0], number))
        assert one == other


def test_a_cell_keeps_the_likeliest_way_and_counts_visits_and_returns() -> None:
    learner = make_learner(hold=5)
    scale = LevelScale(learner._settings.level_ratio)
    cells, noise, found = play(learner, 10)
    costs, visits = {}, dict.fromkeys(learner._cells, 0)
    for cell, z, result in zip(cells, noise, found, strict=True):
        visits[cell] += 1
        for decision in range(cell.decision + 1, 8):
            steps = 5 * decision
            if steps < result.steps:
                through = Cell(decision, scale.find_level(float(result.importance[steps - 1])))
                visits[through] += 1
                cost = float(np.sum(z[:steps].astype(float) ** 2))
                costs[through] = min(cost, costs.get(through, np.inf))
    assert {cell: one.visits for cell, one in learner._cells.items()} == visits
    kept = {cell: one.cost for cell, one in learner._cells.items() if cell != START}
    assert kept == pytest.approx(costs)
    assert max(cell.level for cell in kept) > 1
    for cell, one in learner._cells.items():
        cost = 5 * np.sum(one.noise[: cell.decision].astype(float) ** 2)
        assert cost == pytest.approx(one.cost)


def test_cells_are_chosen_by_the_inverse_square_root_of_their_visits() -> None:
    learner = make_learner(hold=20, round_size=10_000)
    play(learner, 1)
    (visits,) = [one.visits for cell, one in learner._cells.items() if cell == START]
    assert visits == 1000
    learner._cells = {
        cell: type(one)(count, one.cost, one.noise)
        for (cell, one), count in zip(learner._cells.items(), [99, 0, 3], strict=False)
    }
    cells, _, _ = play(learner, 1)
    shares = [cells.count(cell) / len(cells) for cell in list(dict.fromkeys(cells))]
    # Weights of 1/10, 1 and 1/2.
    expected = sorted(weight / 1.6 for weight in (0.1, 1.0, 0.5))
    assert sorted(shares) == pytest.approx(expected, abs=4 * 0.5 / np.sqrt(1000))


def test_new_values_are_normal_with_the_scale() -> None:
    cells, noise, _ = play(make_learner(hold=1, scale=2.0), 40)
    fresh = np.concatenate(
        [z[cell.decision :].ravel() for cell, z in zip(cells, noise, strict=True)]
    )
    assert fresh.mean() == pytest.approx(0.0, abs=2.0 * 4 / np.sqrt(len(fresh)))
    assert fresh.std() == pytest.approx(2.0, abs=2.0 * 4 / np.sqrt(2 * len(fresh)))


def test_its_rare_states_come_more_often_than_under_the_same_noise_alone() -> None:
    """Half of the way to the wall is rare; cells there are returned to."""
    learner = make_learner(hold=5, level_ratio=1.1)
    cells, _, found = play(learner, 50)
    random = np.random.default_rng(2)
    held = np.repeat(random.standard_normal((20_000, 8, 2)), 5, axis=1)
    share = float((CORRIDOR.course(held).max(axis=1) >= 1.1).mean())
    assert 0.01 < share < 0.2
    reached = np.mean([float(result.importance.max()) >= 1.1 for result in found])
    assert reached > 1.5 * share
    assert len(set(cells)) > 30


@pytest.mark.parametrize("importance", list(Importance))
def test_the_importance_of_the_settings_is_asked_for(importance) -> None:
    sources = make_learner(importance=importance).propose(3).sources
    assert [source.importance for source in sources] == [importance] * 3


def test_levels_grow_by_their_ratio_and_have_a_sign() -> None:
    scale = LevelScale(2.0)
    values = [0.0, 0.9, 1.0, 2.9, 3.0, -0.5, -1.0, -3.0, np.nan]
    assert [scale.find_level(each) for each in values] == [0, 0, 1, 1, 2, -1, -2, -3, 0]
    assert scale.find_level(np.inf) == scale.find_level(1e12) > 15


def test_an_episode_that_could_not_be_run_finds_no_cell_and_counts_as_a_visit() -> None:
    learner = make_learner(round_size=4)
    play(learner, 1, engine=ToyEngine(CORRIDOR, range(4)))
    assert {cell: one.visits for cell, one in learner._cells.items()} == {START: 4}


def test_results_without_importance_are_refused() -> None:
    learner = make_learner(round_size=1)
    (source,) = learner.propose(1).sources
    results = list(ToyEngine(CORRIDOR).run([EpisodeTask(0, 0, type(source)(source.z))]))
    with pytest.raises(LearnerFailed, match="without the importance"):
        learner.observe(results)


def test_a_state_holds_the_noise_of_an_episode_once() -> None:
    learner = make_learner(hold=5)
    play(learner, 3)
    rows = archive.read("go_explore", learner.state(), GoExplore._Facts)[1]
    kept = {one.noise.tobytes() for one in learner._cells.values()}
    assert len(rows["noise"]) == len(kept) < len(rows["cells"])


@pytest.mark.parametrize(
    ("name", "value"),
    [("rows", 10_000), ("cells", 7), ("open_cells", 7)],
)
def test_a_state_that_contradicts_itself_is_refused(name, value) -> None:
    learner = make_learner(hold=5)
    play(learner, 2)
    learner.propose(4)
    facts, arrays = archive.read("go_explore", learner.state(), GoExplore._Facts)
    arrays[name] = np.full_like(arrays[name], value)
    with pytest.raises(ProtocolError):
        make_learner(hold=5).restore(archive.write("go_explore", facts, arrays))
