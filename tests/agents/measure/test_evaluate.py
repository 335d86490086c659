"""Held-out flights and their statistics, with policies that need no training."""

import math

import numpy as np
import pytest
from gymnasium.spaces import Box
from stable_baselines3.common.evaluation import evaluate_policy

from agents.experiment.config import Experiment, Options
from agents.experiment.environments import CollisionPenalty, checked, make_vector_env
from agents.experiment.runs import create_run
from agents.learn.algorithms import SCENES_PER_SEED
from agents.learn.episodes import EPISODE, EpisodeCounter
from agents.learn.sb3_vec import Sb3VectorEnv
from agents.measure.evaluate import FIRST_HELD_OUT, evaluate, evaluate_run, fly, held_out_scenes
from agents.measure.results import flight_row, flights, summary
from agents.measure.statistics import exact_bounds
from agents.report.rates import percentage
from agents.report.tables import aligned

AVOID = Experiment()
SCENES = held_out_scenes(20)
SPACE = Box(-np.inf, np.inf, (20,), np.float32)


class AtTheGoal:
    """Flies straight at the goal."""

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        actions = np.zeros((len(observation), 4), dtype=np.float32)
        actions[:, :3] = np.clip(4.0 * observation[:, :3], -1.0, 1.0)
        return actions, None


def test_held_out_scenes_start_above_every_training_scene():
    assert held_out_scenes(3) == [2**63, 2**63 + 1, 2**63 + 2]
    assert (2**32 - 1) * SCENES_PER_SEED + SCENES_PER_SEED <= FIRST_HELD_OUT


def test_each_scene_is_flown_once_and_alike_alone_or_among_others():
    together = fly(AtTheGoal(), make_vector_env(AVOID, len(SCENES), False), SCENES)
    alone = [fly(AtTheGoal(), make_vector_env(AVOID, 1, False), [scene])[0] for scene in SCENES[:5]]
    assert together[:5].tolist() == [episode.item() for episode in alone]
    backwards = fly(AtTheGoal(), make_vector_env(AVOID, len(SCENES), False), SCENES[::-1])
    assert backwards[::-1].tolist() == together.tolist()


def test_the_shield_keeps_the_same_flights_clear():
    without = fly(AtTheGoal(), make_vector_env(AVOID, len(SCENES), False), SCENES)
    shielded = fly(AtTheGoal(), make_vector_env(AVOID, len(SCENES), True), SCENES)
    assert without["violation"].mean() > 0.3 and (without["clearance"] < 0).sum() == without["violation"].sum()
    assert not shielded["violation"].any() and (shielded["clearance"] > 0).all()
    assert not without["interventions"].any() and (shielded["interventions"] > 0).sum() > 6
    assert (shielded["interventions"] <= shielded["length"]).all()


def test_agrees_with_the_evaluation_of_stable_baselines():
    adapter = Sb3VectorEnv(make_vector_env(AVOID, 8, False))
    adapter.seed(SCENES[0])
    returns, lengths = evaluate_policy(AtTheGoal(), adapter, n_eval_episodes=8, return_episode_rewards=True)
    episodes = fly(AtTheGoal(), make_vector_env(AVOID, 8, False), SCENES[:8])
    # It takes the rows in the order in which they end.
    assert sorted(lengths) == sorted(episodes["length"].tolist())
    assert sorted(returns) == pytest.approx(sorted(episodes["return"]), abs=1e-12)


def test_every_ending_is_kept_apart():
    counter = EpisodeCounter(make_vector_env(AVOID, 5, False))
    counter.start()
    nothing = np.zeros(5, dtype=bool)
    info = {
        "cost": np.array([1.0, 0, 0, 0, 0]),
        "clearance": np.array([-0.1, 1, 1, 1, np.inf]),
        "violation": np.array([True, False, False, False, False]),
        "out_of_bounds": np.array([False, True, False, False, False]),
        "crash": np.array([False, False, True, False, False]),
        "invalid_action": nothing,
        "is_success": np.array([False, False, False, False, True]),
    }
    finished = counter.add(
        np.ones(5),
        np.array([True, True, True, False, True]),
        np.array([False, False, False, True, False]),
        info,
    )
    row = summary(finished)
    kinds = ("violations", "out_of_bounds", "crashes", "timeouts", "successes")
    assert [row[kind] for kind in kinds] == [1] * 5
    assert row["clearance"] == -0.1 and row["return"] == row["length"] == 1.0
    assert counter.add(np.ones(5), nothing, nothing, info).size == 0


def test_path_and_interventions_are_those_of_a_slow_count():
    env, n, period = make_vector_env(AVOID, 6, True), 6, 0.04
    observations, _ = env.reset(options={"scene": SCENES[:n]})
    counter = EpisodeCounter(env)
    counter.start()
    path, acts, sizes = np.zeros(n), [[] for _ in range(n)], [[] for _ in range(n)]
    for _ in range(60):
        path += period * np.linalg.norm(env.unwrapped.flat_state()[:, 1], axis=1)
        observations, rewards, terminated, truncated, info = env.step(AtTheGoal().predict(observations)[0])
        assert not (terminated | truncated).any()
        counter.add(rewards, terminated, truncated, info)
        for i in range(n):
            acts[i].append(bool(info["shield"]["intervened"][i]))
            sizes[i].append(info["shield"]["correction"][i])
    found = counter.snapshot()["open"]
    np.testing.assert_allclose(found["path"], path, rtol=1e-12)
    assert found["interventions"].tolist() == [sum(row) for row in acts] and found["interventions"].any()
    words = ["".join("x" if act else " " for act in row).split() for row in acts]
    assert found["segments"].tolist() == [len(runs) for runs in words]
    np.testing.assert_allclose(found["correction"], np.sum(sizes, axis=1))
    np.testing.assert_allclose(found["largest_correction"], np.max(sizes, axis=1))


class Blind:
    """Flies one way, whatever it sees."""

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        return np.full((len(observation), 4), 0.3, dtype=np.float32), None


def blank(q):
    return np.full((*q.thrust.shape, 20), 0.7)


@pytest.mark.parametrize("is_shielded", [False, True])
def test_paths_do_not_depend_on_what_is_observed(is_shielded):
    ways = {}
    for name, observation in (("own", "relative"), ("world", "world"), ("blank", (blank, SPACE))):
        experiment = Experiment(env_kwargs={"observation": observation})
        ways[name] = fly(Blind(), make_vector_env(experiment, 6, is_shielded), SCENES[:6])
    assert ways["world"].tolist() == ways["blank"].tolist() == ways["own"].tolist()
    assert ways["own"]["path"].min() > 0.1


def test_only_what_follows_a_reference_has_a_tracking_error():
    assert "rms_error" not in fly(AtTheGoal(), make_vector_env(AVOID, 1, False), SCENES[:1]).dtype.names
    track = Experiment(env="QuadSafe/Track-v0", env_kwargs={"max_episode_steps": 40})
    flown = fly(AtTheGoal(), make_vector_env(track, 4, True), SCENES[:4])
    shielded, errors = make_vector_env(track, 4, True), []
    observations, _ = shielded.reset(options={"scene": SCENES[:4]})
    for _ in range(40):
        observations, *_, info = shielded.step(AtTheGoal().predict(observations)[0])
        errors.append(info["tracking_error"])
    np.testing.assert_allclose(flown["rms_error"], np.sqrt(np.mean(np.square(errors), axis=0)))
    row = flight_row("given", 0, True, flown)
    assert row["rms_error_least"] < row["rms_error"] == flown["rms_error"].mean() < row["rms_error_most"]


def test_a_counter_goes_on_from_a_snapshot():
    def counted(*parts):
        env = make_vector_env(AVOID, 4, True)
        observations, _ = env.reset(options={"scene": SCENES[:4]})
        counter = EpisodeCounter(env)
        counter.start()
        for steps in parts:
            snapshot, counter = counter.snapshot(), EpisodeCounter(env)
            counter.restore(snapshot)
            for _ in range(steps):
                told = env.step(AtTheGoal().predict(observations)[0])
                observations = told[0]
                counter.add(*told[1:])
        return counter.snapshot()["open"].tolist()

    assert counted(50) == counted(13, 0, 37)


def test_every_agent_flies_the_same_scenes(tmp_path):
    run = create_run(
        checked(Experiment(arms=("tracker", "random"), n_seeds=2)), Options(log_folder=tmp_path), {}
    )
    for arm, seed in run.experiment.jobs():
        evaluate(run, arm, seed, 10)
    tracked, wild, wilder = (
        [flights(run, arm, seed, shield) for shield in (False, True)]
        for arm, seed in (("tracker", 0), ("random", 0), ("random", 1))
    )
    for pair in (tracked, wild, wilder):
        assert [flown["scene"].tolist() for flown in pair] == [SCENES[:10]] * 2
    assert tracked[0]["violation"].sum() >= 8 and not tracked[1]["violation"].any()
    assert tracked[1]["is_success"].sum() >= 8
    assert not np.array_equal(wild[0]["return"], wilder[0]["return"])
    with pytest.raises(FileNotFoundError, match="run must hold a trained policy, got none"):
        evaluate_run(create_run(AVOID, Options(log_folder=tmp_path), {}))


def test_a_collision_penalty_is_paid_for_each_violation_and_nothing_else():
    plain, paying = make_vector_env(AVOID, 8, False), CollisionPenalty(make_vector_env(AVOID, 8, False), 3.0)
    observations = [env.reset(seed=3)[0] for env in (plain, paying)]
    paid = 0.0
    for _ in range(80):
        actions = AtTheGoal().predict(observations[0])[0]
        (observations[0], rewards, *_, info), (observations[1], others, *_) = (
            env.step(actions) for env in (plain, paying)
        )
        np.testing.assert_allclose(others, rewards - 3.0 * info["cost"], atol=1e-12)
        paid += info["cost"].sum()
    assert paid > 0


def test_clopper_pearson_bounds():
    # 3 of 10: 6.67 % to 65.25 %, as tabulated; zero of n has the closed form 1 - 0.05^(1/n).
    assert exact_bounds(3, 10) == pytest.approx((0.0667395, 0.6524529), abs=1e-6)
    assert exact_bounds(0, 300) == (0.0, pytest.approx(1 - 0.05 ** (1 / 300), abs=1e-12))
    assert exact_bounds(200, 200) == (pytest.approx(0.05 ** (1 / 200), abs=1e-12), 1.0)


@pytest.mark.parametrize(("p", "n"), [(0.02, 40), (0.3, 15), (0.5, 8)])
def test_the_bounds_hold_the_rate_in_19_of_20_experiments(p, n):
    bounds = [exact_bounds(k, n) for k in range(n + 1)]
    weights = [math.comb(n, k) * p**k * (1 - p) ** (n - k) for k in range(n + 1)]
    covered = sum(weight for weight, (low, high) in zip(weights, bounds, strict=True) if low <= p <= high)
    assert covered >= 0.95


def test_percentages_carry_their_bounds():
    def row(k, n):
        low, high = exact_bounds(k, n)
        return {"rate": k / n, "rate_least": low, "rate_most": high, "rate_low": None, "rate_high": None}

    assert percentage(row(0, 200), "rate") == "0 [<= 1.5]"
    assert percentage(row(200, 200), "rate") == "100 [>= 98.5]"
    assert percentage(row(14, 200), "rate") == "7.0 [3.9, 11.5]"
    assert percentage(row(1, 2000), "rate") == "0.05 [0.001, 0.28]"
    assert percentage({"rate": None}, "rate") == "-"
    # Two of 20,000 in one of ten seeds: the middle of the seeds is 0, and would hide them.
    few = {**row(2, 20_000), "rate": 0.0, "rate_low": 0.0, "rate_high": 0.0002, "episodes": 20_000}
    counted = {name.replace("rate", "violation_rate"): value for name, value in few.items()}
    assert percentage({**counted, "violations": 2}, "violation_rate") == "0.01 [0.001, 0.04]"
    # Of several seeds, the interval over seeds; of nothing counted, still the bound over all episodes.
    assert percentage({**row(14, 200), "rate_low": 0.05, "rate_high": 0.08}, "rate") == "7.0 [5.0, 8.0]"
    assert percentage({**row(0, 200), "rate_low": 0.0, "rate_high": 0.0}, "rate") == "0 [<= 1.5]"


def test_a_summary_of_nothing_has_no_rates():
    row = summary(np.zeros(0, EPISODE))
    assert row["episodes"] == 0 and row["violation_rate"] is row["return"] is row["clearance"] is None


def test_columns_line_up():
    assert (
        aligned([["", "n"], ["with", "10,000"], ["x", "1"]]) == "             n\n  with  10,000\n  x          1"
    )


def test_checked_spells_out_the_kind_of_shield_and_leaves_the_rest_to_the_plant():
    shield = checked(Experiment(shield={"alpha": 3.0, "intervention_penalty": 0.1})).shield
    assert shield["alpha"] == 3.0 and shield["intervention_penalty"] == 0.1
    assert (shield["method"], shield["inner_loop"]) == ("sampled", "proved")
    assert "snap_max" not in shield and "uncertainty" not in shield


@pytest.mark.parametrize(
    ("experiment", "named"),
    [
        (Experiment(env="Pendulum-v1"), "env must be one of 'QuadSafe/Flight-v0'"),
        (Experiment(action="thrust"), "action must be one of"),
        (Experiment(env_kwargs={"policy_hz": 7}), "policy_hz must divide"),
        (Experiment(env_kwargs={"wings": 2}), "unexpected keyword argument 'wings'"),
        (
            Experiment(env_kwargs={"autoreset_mode": "NextStep"}),
            "autoreset_mode must be 'SameStep' in a run, got",
        ),
        (Experiment(shield={"info_format": "tidy"}), "info_format must be one of 'nested', 'flat'"),
        (Experiment(shield={"snap_max": -1}), "snap_max must be a finite number > 0"),
        (Experiment(shield={"armour": 2}), "unexpected keyword argument 'armour'"),
    ],
)
def test_an_experiment_that_cannot_be_built_is_refused(experiment, named):
    with pytest.raises((ValueError, TypeError), match=named):
        checked(experiment)
