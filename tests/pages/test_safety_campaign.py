"""The safety campaign in short: attacks, flights among many spheres, the bare chain, with counter-cases."""

import numpy as np
import pytest
from house import ROOT, script

# One interface and rate for each attack; together they cover both ends of the rates and every interface.
CASES = (
    ("tracker", "snap", 25),
    ("overhead", "velocity", 100),
    ("orbit", "wrench", 25),
    ("random", "snap", 100),
    ("climber", "wrench", 25),
    ("paid policy", "velocity", 25),
)
# Attacks by the yaw motion at 50 Hz of control and physics: every pilot, and every interface, with every arm.
YAW = ("spin snap", "alternate velocity", "tumble wrench")
YAW_VEHICLES = ("moon off sphere", "J_z > 2 J_x off sphere", "crazyflie loss 0.9 forest")
# Among shapes: one and many, at rest and moving, with and without the shield; and flights through openings.
AMONG = (
    "shapes sampled snap 25 box 0.0",
    "shapes sampled velocity 25 joint 0.5",
    "shapes none snap 25 box 0.0",
)
AMONG += ("shapes none velocity 25 joint 0.5", "course Rooms follower 20 0.80", "course Gates diver 24 0.16")


@pytest.fixture(scope="module")
def safety():
    with script("benchmarks", "safety") as module:
        yield module


@pytest.fixture(scope="module")
def jobs(safety, tmp_path_factory):
    """The jobs of a short campaign that the tests fly."""
    scale = safety.SHORT._replace(training_steps=8_192, flights=8, samples=500)
    cases = {f"{arm} {attack} {action} {rate} " for arm in safety.ARMS for attack, action, rate in CASES}
    yaw = {f"yaw {arm} {attack} 50 50 crazyflie off" for arm in safety.YAW_ARMS for attack in YAW}
    yaw |= {f"yaw sampled {attack} 50 50 {vehicle}" for attack in YAW for vehicle in YAW_VEHICLES}
    kinds = (*cases, *yaw, *AMONG, "forest 20 2.0", "chain 2 25", "chain 4 25", "border")
    return [
        job for job in safety.jobs(scale, 0, tmp_path_factory.mktemp("weights")) if job.key.startswith(kinds)
    ]


@pytest.fixture(scope="module")
def results(safety, jobs, tmp_path_factory):
    """The results of those jobs."""
    results = safety.Results(tmp_path_factory.mktemp("campaign") / "safety.csv")
    safety.run_campaign(jobs, results)
    return results


@pytest.fixture(scope="module")
def tables(safety):
    return safety.tables


def count(tables, results, column, *kinds, **columns):
    part = tables.kind(results.rows, *kinds, **columns)
    assert part
    return tables.total(part, column)


def test_no_attack_violates_the_sampled_shield(tables, results):
    assert count(tables, results, "steps", "attack", arm="sampled") >= 12_000
    assert count(tables, results, "violated_steps", "attack", arm="sampled") == 0
    # Neither does one throw the vehicle out of the range of the flat map.
    assert count(tables, results, "crashes", "attack", arm="sampled") == 0


@pytest.mark.parametrize("arm", ["cbf", "none"])
def test_the_attacks_do_violate_the_other_arms(tables, results, arm):
    assert count(tables, results, "violated_episodes", "attack", arm=arm) > 0


@pytest.mark.parametrize("attack", ["tracker", "overhead", "orbit", "random", "climber"])
def test_each_attack_collides_without_a_shield(tables, results, attack):
    assert count(tables, results, "violated_episodes", "attack", arm="none", attack=attack) > 0


def test_no_spin_takes_a_certificate_or_leaves_its_range(tables, results):
    assert count(tables, results, "steps", "yaw", arm="sampled") >= 12_000
    for column in ("violated_steps", "lost_certificates", "uncertified", "crashes", "spinning"):
        assert count(tables, results, column, "yaw", arm="sampled") == 0, column


def test_spins_do_take_certificates_of_a_shield_that_does_not_count_on_them(tables, results):
    assert count(tables, results, "lost_certificates", "yaw", arm="measured") > 0


@pytest.mark.parametrize("attack", ["spin", "alternate", "tumble"])
def test_each_spinning_pilot_collides_without_a_shield(tables, results, attack):
    assert count(tables, results, "violated_episodes", "yaw", arm="none", attack=attack) > 0


def test_a_certificate_is_lost_where_one_was_in_the_same_episode(safety):
    tally = safety.spinning.SpinTally(4, periods=3)
    info = {name: np.zeros(4) for name in ("cost", "crash", "out_of_bounds", "clearance", "spinning")}
    counts = {name: np.zeros(4) for name in ("interventions", "refusals", "stopped")}
    # Always one; lost; an episode that ends; never one.
    for certified, ended in (([1, 1, 1, 0], [0, 0, 1, 0]), ([1, 0, 0, 0], [0] * 4)):
        shield = {**counts, "certified": np.array(certified, dtype=np.bool_)}
        tally.add({**info, "shield": shield}, np.array(ended, dtype=np.bool_))
    assert tally.counts["lost_certificates"] == 1
    assert (tally.counts["uncertified"], tally.counts["steps"]) == (4, 24)


def test_results_with_other_columns_are_refused(safety, tmp_path):
    path = tmp_path / "old.csv"
    path.write_text("key,revision\n")
    with pytest.raises(ValueError, match=r"^path must be a file with the columns key,.*, got key,revision$"):
        safety.Results(path)


def test_among_20_spheres_the_shield_keeps_clear_and_keeps_flying(tables, results):
    assert count(tables, results, "violated_episodes", "forest", arm="none") > 0
    assert count(tables, results, "violated_steps", "forest", arm="sampled") == 0
    safe, bare = (tables.kind(results.rows, "forest", arm=arm)[0] for arm in ("sampled", "none"))
    assert float(safe["mean_speed"]) >= 0.9 * float(bare["mean_speed"])
    assert int(safe["stuck"]) == 0


def test_no_hunt_among_shapes_violates_the_shield_and_most_do_without_it(tables, results):
    for shape in ("box", "joint"):
        assert count(tables, results, "violated_steps", "shapes", arm="sampled", attack=shape) == 0
        assert count(tables, results, "uncertified", "shapes", arm="sampled", attack=shape) == 0
        episodes = count(tables, results, "episodes", "shapes", arm="none", attack=shape)
        assert count(tables, results, "violated_episodes", "shapes", arm="none", attack=shape) > 0.4 * episodes


def test_through_rooms_and_gates_the_shield_keeps_clear_and_keeps_flying(tables, results):
    assert count(tables, results, "violated_steps", "course", arm="sampled") == 0
    assert count(tables, results, "violated_episodes", "course", arm="none", attack="diver") > 0
    safe, bare = (tables.kind(results.rows, "course", arm=arm, task="Rooms")[0] for arm in ("sampled", "none"))
    assert float(safe["mean_speed"]) >= 0.95 * float(bare["mean_speed"])
    assert int(safe["stuck"]) == 0


def test_every_table_is_made_of_the_results(safety, results):
    for name, make in safety.shape_tables.TABLES.items():
        assert make(results.rows).count("\n") >= 2, name


def test_the_bare_chain_keeps_its_bound_between_samples_too(tables, results):
    assert count(tables, results, "steps", "chain 2", "chain 4") == 1_000_000
    assert count(tables, results, "violated_steps", "chain 2", "chain 4") == 0


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_the_set_is_the_largest(tables, results, order):
    assert count(tables, results, "violated_episodes", f"border {order}", arm="inside") == 0
    assert count(tables, results, "violated_episodes", f"border {order}", arm="outside") == 500


def test_a_campaign_is_taken_up_where_it_was_cut_off(safety, jobs, tmp_path):
    path = tmp_path / "safety.csv"
    few = [job for job in jobs if job.key.startswith("border")]
    safety.run_campaign(few[:1], safety.Results(path))
    whole = path.read_text()
    path.write_text(whole + "border 2 0,abc")
    results = safety.Results(path)
    assert path.read_text() == whole
    safety.run_campaign(few[:2], results)
    assert path.read_text().startswith(whole)
    assert [row["key"] for row in results.rows] == [job.key for job in few[:2] for _ in range(2)]


def test_a_job_gives_the_same_counts_again(jobs):
    job = next(job for job in jobs if job.key.startswith("sampled climber"))
    first, second = ({**job.run()[0], "seconds": 0.0} for _ in range(2))
    assert first == second


def test_the_tables_of_the_document_are_those_of_its_data(tables, safety):
    text = (ROOT / "docs/safety.md").read_text(encoding="utf-8")
    rows = safety.Results(ROOT / "docs/data/safety.csv").rows
    assert tables.filled(text, rows, tables.TABLES) == text


def test_upper_bound_is_exact_next_to_zero():
    from safety_campaign.results import upper_bound

    # (1 − p)^n = 0.05 at the bound.
    assert upper_bound(0, 300) == pytest.approx(1.0 - 0.05 ** (1 / 300), rel=1e-9)
