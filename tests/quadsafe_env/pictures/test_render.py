"""Frames: what they show, and that they need no display."""

import os
import subprocess
import sys

import gymnasium
import numpy as np
import pygame
import pytest

import quadsafe_env  # noqa: F401
from quadsafe_core.shapes import Obstacles
from quadsafe_env.pictures.camera import STRAIGHT, view_of
from quadsafe_env.pictures.render import ACTS, BREACH, NOSE, ROTOR, frame, tints_of
from quadsafe_env.pictures.sprites import GOAL, OBSTACLE
from quadsafe_env.pictures.trail import LENGTH, NO_PAST, Past, Trail
from quadsafe_env.pictures.window import HELP, TURN, ZOOM, Window, has_display
from quadsafe_env.registration import IDS
from quadsafe_env.vehicle.params import PRESETS
from quadsafe_env.vehicle.state import ATTITUDE, OMEGA, THRUST, hover_state
from shields import ShieldWrapper, VectorShieldWrapper

CRAZYFLIE = PRESETS["crazyflie"]
START, FINISH = np.array([-2.0, 0.0, 0.0]), np.array([2.0, 0.5, 0.3])
# Pictures that kernels draw in plain Python too.
SMALL = 40


def spheres(*rows, keep_out=CRAZYFLIE.radius):
    """Keep-out spheres of rows x, y, z, radius."""
    table = np.reshape(np.array(rows, dtype=float), (-1, 4))
    return Obstacles(table[:, :3].copy(), table[:, 3].copy(), keep_out=keep_out)


NO_SPHERES, ONE_SPHERE = spheres(), spheres([0.0, 0.0, 0.0, 0.6])


def picture(position=START, obstacles=ONE_SPHERE, params=CRAZYFLIE, past=NO_PAST, size=480):
    return frame(hover_state(position, params), FINISH, obstacles, params, START, past=past, size=size)


def count(image, color, tolerance=25):
    """Pixels of about this colour, at about its brightness."""
    return int((np.abs(image.astype(int) - np.array(color)).max(axis=-1) < tolerance).sum())


def place_of(image, color):
    """Middle of the pixels of a colour, (x, y)."""
    rows, columns = np.nonzero(np.abs(image.astype(int) - np.array(color)).max(axis=-1) < 25)
    return np.array([columns.mean(), rows.mean()])


@pytest.mark.interpreted
def test_frame_is_an_image_of_the_callers_own():
    first, second = picture(size=SMALL), picture(size=SMALL)
    assert first.shape == (SMALL, SMALL, 3) and first.dtype == np.uint8
    assert first.flags.c_contiguous and first.flags.writeable
    assert not np.shares_memory(first, second)
    np.testing.assert_array_equal(first, second)
    first[:] = 0
    np.testing.assert_array_equal(picture(size=SMALL), second)


def test_everything_is_in_the_picture():
    image = picture()
    assert min(count(image, color) for color in (GOAL, NOSE, ROTOR)) > 10
    # A lit ball is dark below; its hue is what stays.
    ball = image.astype(float).reshape(-1, 3)
    hue = np.abs(ball / np.maximum(ball[:, :1], 1) - np.array(OBSTACLE) / OBSTACLE[0]).max(axis=1) < 0.15
    assert (hue & (ball[:, 0] > 60)).sum() > 2000
    assert not np.array_equal(picture(obstacles=NO_SPHERES), image)


def rim_color(position):
    """Colour of the shell where it is brightest, just inside its outline on the right."""
    view = view_of(np.asarray(position), FINISH, START)
    column, row = view.pixels([0.0, 0.0, 0.0])
    edge = column + 0.985 * view.focal * 0.6 / np.sqrt(view.eye @ view.eye - 0.6**2)
    return picture(position)[round(row), round(edge)].astype(float)


def test_path_runs_from_left_to_right_and_the_ground_is_below():
    view = view_of(START, FINISH, START)
    (left, _), (right, _), (_, low), (_, high) = view.pixels([START, FINISH, [0, 0, -1], [0, 0, 1]])
    assert 40 < left < 200 and 280 < right < 440
    assert low > high


@pytest.mark.parametrize("seed", range(20))
def test_vehicle_is_seen_wherever_it_is(seed):
    position = np.random.default_rng(seed).normal(size=3) * 10.0 ** (seed % 4)
    view = view_of(position, FINISH, START)
    assert (np.abs(view.pixels(position) - 240) < 230).all()
    assert count(picture(position, NO_SPHERES), NOSE) > 10


def test_camera_stays_while_the_vehicle_is_near():
    views = [view_of(np.array(p), FINISH, START) for p in ([-1, 0, 0], [1, 1, 0], [0, -1, 1])]
    for view in views[1:]:
        np.testing.assert_array_equal(view.eye, views[0].eye)


def test_vehicle_moves_and_tilts_in_the_picture():
    left, right = (place_of(picture([x, 0.0, 1.2]), NOSE) for x in (-1.5, 1.5))
    assert right[0] > left[0] + 100
    tilted = hover_state(START, CRAZYFLIE)
    tilted[ATTITUDE:OMEGA] = [0, 0, 1, 0, 1, 0, -1, 0, 0]
    image = frame(tilted, FINISH, ONE_SPHERE, CRAZYFLIE, START)
    assert not np.array_equal(image, picture())
    more = hover_state(START, CRAZYFLIE)
    more[THRUST] *= 2.0
    assert not np.array_equal(frame(more, FINISH, ONE_SPHERE, CRAZYFLIE, START), picture())


def test_shell_turns_red_around_a_vehicle_inside():
    outside, inside = rim_color([-0.61, 0.0, 0.0]), rim_color([-0.59, 0.0, 0.0])
    # Hues: the shell lets a part of what is behind it through.
    assert outside[2] > 1.3 * outside[0]
    assert inside[0] > 1.7 * inside[2]


def test_vehicle_behind_a_sphere_leaves_a_trace():
    behind = view_of(START, FINISH, START).axes[2]
    hidden, shown = picture(1.5 * behind), picture(-1.5 * behind)
    assert count(shown, NOSE) > 10 > count(hidden, NOSE)
    assert not np.array_equal(hidden, picture(1.6 * behind))


@pytest.mark.interpreted
@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize(
    "rows",
    [
        [],
        [[0, 0, 0, 0], [0, 0, 0, 0]],
        [[3, 3, 3, 5], [0, -20, 9, 3], [0, 0, 0, 1e4]],
        [[0, 0, 0, 0.01]],
        [[1e6, 0, 0, 1]],
    ],
)
def test_odd_scenes_are_drawn_too(rows, preset):
    params = PRESETS[preset]
    obstacles = spheres(*rows, keep_out=params.radius)
    assert picture(obstacles=obstacles, params=params, size=SMALL).shape == (SMALL, SMALL, 3)
    # Start, goal and vehicle in one place.
    at_once = frame(hover_state(START, params), START, obstacles, params, START, size=SMALL)
    assert at_once.shape == (SMALL, SMALL, 3)


@pytest.mark.parametrize("name", IDS)
def test_env_renders(name):
    env = gymnasium.make(name, render_mode="rgb_array")
    env.reset(seed=0)
    before = env.render()
    for _ in range(10):
        env.step(np.array([0.5, 0.5, 0.5, 0.0], dtype=np.float32))
    after = env.render()
    assert before.shape == after.shape == (480, 480, 3)
    assert not np.array_equal(before, after)
    np.testing.assert_array_equal(env.render(), after)


def test_no_render_mode_no_frame():
    assert gymnasium.make("QuadSafe/Avoid-v0").unwrapped.render() is None
    assert gymnasium.make_vec("QuadSafe/Avoid-v0", 2).render() is None


def test_frames_are_collected_by_gymnasium():
    env = gymnasium.make("QuadSafe/Avoid-v0", render_mode="rgb_array_list")
    env.reset(seed=0)
    for _ in range(4):
        env.step(np.zeros(4, dtype=np.float32))
    frames = env.render()
    assert len(frames) == 5 and {f.shape for f in frames} == {(480, 480, 3)}


@pytest.mark.interpreted
def test_rows_of_the_vector_env_are_the_single_envs_frames():
    looks = {"render_mode": "rgb_array", "render_size": SMALL}
    rows = gymnasium.make_vec("QuadSafe/Avoid-v0", 3, **looks)
    rows.reset(seed=4)
    frames = rows.render()
    assert isinstance(frames, tuple) and len(frames) == 3
    for i, image in enumerate(frames):
        env = gymnasium.make("QuadSafe/Avoid-v0", **looks)
        env.reset(seed=4 + i)
        np.testing.assert_array_equal(env.render(), image)


@pytest.mark.interpreted
def test_trail_goes_through_every_position_and_stays_bounded():
    path = np.random.default_rng(0).normal(size=(5 * LENGTH, 3))
    acts = np.zeros(len(path), dtype=bool)
    acts[[7, 2000]] = True
    trail = Trail(path[0])
    for k in range(1, len(path)):
        trail.add(path[k], bool(acts[k]))
        if k > 3 and k % 97 and k + 1 < len(path):
            continue
        points, corrected = trail.arrays()
        assert len(points) == len(corrected) <= LENGTH + 1
        np.testing.assert_array_equal(points[[0, -1]], path[[0, k]])
        if k < LENGTH:
            np.testing.assert_array_equal(points, path[: k + 1])
            np.testing.assert_array_equal(corrected, acts[: k + 1])
    stride = 8
    np.testing.assert_array_equal(points[:-1], path[:-1:stride])
    assert np.flatnonzero(corrected).tolist() == [-(-7 // stride), 2000 // stride]


def test_trail_is_in_the_picture_and_gone_after_reset():
    env = gymnasium.make("QuadSafe/Avoid-v0", render_mode="rgb_array").unwrapped
    env.reset(seed=0)
    first = env.render()
    states = [env.state]
    for _ in range(12):
        env.step(np.array([0.5, 0.5, 0.5, 0.0], dtype=np.float32))
        states.append(env.state)
    trail = env._world.past(0).trail
    np.testing.assert_array_equal(trail, np.array(states)[:, :3])
    obstacles, start = env._world.obstacles_of(0), env._world.scenes.start[0]
    bare = frame(env.state, env.goal, obstacles, env.params, start)
    assert (env.render() != bare).any(axis=-1).sum() > 30
    env.reset(seed=0)
    np.testing.assert_array_equal(env.render(), first)
    env.state = states[5]
    np.testing.assert_array_equal(env._world.past(0).trail, [states[5][:3]])


def test_trail_behind_a_sphere_is_hidden():
    behind = view_of(START, FINISH, START).axes[2]
    ways = [side * 1.2 * behind + np.linspace(-0.3, 0.3, 9)[:, None] * [0, 0, 1] for side in (1, -1)]
    hidden, shown = (picture(past=Past(way, np.ones(9, dtype=bool))) for way in ways)
    assert count(shown, ACTS) > 20 > count(hidden, ACTS)


def test_shell_turns_amber_for_the_sphere_that_the_filter_answers_for():
    pasts = [NO_PAST._replace(is_corrected=True, obstacle=k) for k in (0, 1)]
    for k, past in enumerate(pasts):
        tints = tints_of(np.array([0.1, 0.2]), past)
        assert tints[k] == ACTS and 1 - k not in tints
    assert tints_of(np.array([-0.1, 0.2]), pasts[0])[0] == BREACH
    acts, idle = picture(past=pasts[0]), picture()
    assert count(acts[:40, :140], ACTS) > 60 and count(idle, ACTS) == 0
    # Corrected, but for no sphere: the vehicle's authority, say.
    for_none = picture(past=NO_PAST._replace(is_corrected=True))
    np.testing.assert_array_equal(for_none[40:], idle[40:])


def towards(env):
    way = env.unwrapped.goal - env.unwrapped.state[..., :3]
    return np.concatenate([0.8 * way / np.abs(way).max(), [0.0]]).astype(np.float32)


def test_pictures_say_exactly_when_the_shield_acts():
    env = ShieldWrapper(gymnasium.make("QuadSafe/Avoid-v0", render_mode="rgb_array"))
    env.reset(seed=3)
    told = []
    for _ in range(60):
        shield = env.step(towards(env))[4]["shield"]
        past = env.unwrapped._world.past(0)
        assert (past.is_corrected, past.obstacle) == (shield["intervened"], shield["obstacle"])
        assert (count(env.render()[:40, :140], ACTS) > 60) == shield["intervened"]
        told.append(shield["intervened"])
    np.testing.assert_array_equal(env.unwrapped._world.past(0).was_corrected[1:], told)
    assert 5 < sum(told) < 55
    env.reset(seed=3)
    assert not env.unwrapped._world.past(0).is_corrected
    unshielded = env.remove()
    unshielded.step(towards(unshielded))
    assert count(unshielded.render()[:40, :140], ACTS) == 0


def test_rows_show_the_single_envs_frames_through_a_reset():
    kwargs = {"render_mode": "rgb_array", "max_episode_steps": 12}
    rows = VectorShieldWrapper(gymnasium.make_vec("QuadSafe/Avoid-v0", 2, **kwargs))
    singles = [ShieldWrapper(gymnasium.make("QuadSafe/Avoid-v0", **kwargs)) for _ in range(2)]
    rows.reset(seed=3)
    for i, env in enumerate(singles):
        env.reset(seed=3 + i)
    for _ in range(20):
        actions = np.stack([towards(env) for env in singles])
        rows.step(actions)
        for i, env in enumerate(singles):
            _, _, terminated, truncated, _ = env.step(actions[i])
            if terminated or truncated:
                env.reset()
            np.testing.assert_array_equal(rows.render()[i], env.render())


def test_only_what_is_rendered_remembers_its_path():
    assert not hasattr(gymnasium.make("QuadSafe/Avoid-v0").unwrapped._world, "past")


def test_restored_rows_start_their_trail_there():
    rows = gymnasium.make_vec("QuadSafe/Avoid-v0", 2, render_mode="rgb_array").unwrapped
    rows.reset(seed=0)
    rows.step(np.ones((2, 4), dtype=np.float32))
    kept = rows.snapshot()
    rows.step(np.ones((2, 4), dtype=np.float32))
    rows.restore(kept)
    np.testing.assert_array_equal(rows._world.past(1).trail, rows.state[1:, :3])


@pytest.fixture
def screen(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    yield
    pygame.display.quit()


def test_human_mode_shows_every_step_by_itself(screen):
    env = gymnasium.make("QuadSafe/Avoid-v0", render_mode="human", policy_hz=100)
    twin = gymnasium.make("QuadSafe/Avoid-v0", render_mode="rgb_array", policy_hz=100)
    for moved in (lambda e: e.reset(seed=0), *[lambda e: e.step(np.ones(4, dtype=np.float32))] * 3):
        moved(env)
        moved(twin)
        shown = pygame.surfarray.array3d(pygame.display.get_surface()).swapaxes(0, 1)
        np.testing.assert_array_equal(shown, twin.render())
        assert env.render() is None
    env.close()
    assert not pygame.display.get_init()
    env.close()
    assert count(twin.render(), NOSE) > 10


def test_window_stays_closed_when_the_user_closed_it(screen):
    window = Window(100)
    window.show(picture())
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    window.show(picture())
    assert window.is_closed and not pygame.display.get_init()
    window.show(picture())
    assert not pygame.display.get_init()


def after(window, *events):
    """What the camera is asked for after some events."""
    for kind, facts in events:
        pygame.event.post(pygame.event.Event(kind, facts))
    window.show(picture(size=SMALL))
    return window.steering


def test_mouse_and_keys_steer_the_camera(screen, monkeypatch):
    window, now = Window(1000), [0]
    monkeypatch.setattr(pygame.time, "get_ticks", lambda: now[0])
    drag = (pygame.MOUSEMOTION, {"pos": (9, 9), "rel": (10, 5), "buttons": (1, 0, 0)})
    click, wheel = (pygame.MOUSEBUTTONDOWN, {"pos": (9, 9), "button": 1}), (pygame.MOUSEWHEEL, {"x": 0, "y": 2})
    follow, restore = ((pygame.KEYDOWN, {"key": key}) for key in (pygame.K_f, pygame.K_r))
    assert after(window) == STRAIGHT
    assert after(window, (drag[0], drag[1] | {"buttons": (0, 0, 0)})) == STRAIGHT
    assert after(window, drag, drag) == (-20 * TURN, 10 * TURN, 1.0, False)
    assert after(window, wheel, follow) == pytest.approx((-20 * TURN, 10 * TURN, ZOOM**2, True))
    assert after(window, restore) == STRAIGHT
    for pause, is_restored in ((1000, False), (300, True)):
        after(window, restore, follow, click)
        now[0] += pause
        assert (after(window, click) == STRAIGHT) is is_restored
        now[0] += 1000
    assert pygame.display.get_caption()[0] == HELP
    window.close()


def test_the_next_picture_is_seen_from_where_the_mouse_has_turned_it(screen):
    env, still = (gymnasium.make("QuadSafe/Avoid-v0", render_mode="human", policy_hz=100) for _ in range(2))
    env.reset(seed=0)
    pygame.event.post(pygame.event.Event(pygame.MOUSEMOTION, {"rel": (90, 0), "buttons": (1, 0, 0)}))
    env.step(np.ones(4, dtype=np.float32))
    turned = env.unwrapped._world.picture(0)
    env.close()
    still.reset(seed=0)
    still.step(np.ones(4, dtype=np.float32))
    assert np.abs(turned.astype(int) - still.unwrapped._world.picture(0)).mean() > 1.0
    still.close()


def test_no_display_is_said_in_a_sentence(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "none-such")
    monkeypatch.setenv("DISPLAY", ":0")
    assert not has_display()
    with pytest.raises(OSError, match=r"^render_mode 'human' must have a display"):
        gymnasium.make("QuadSafe/Avoid-v0", render_mode="human").reset(seed=0)


@pytest.mark.parametrize("conditions", [None, "indoor"])
@pytest.mark.parametrize("display", [{}, {"DISPLAY": ":4711"}], ids=["none", "one that is not there"])
def test_no_window_opens_where_nobody_would_see_it(monkeypatch, conditions, display):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER", "SDL_VIDEO_DRIVER"):
        monkeypatch.delenv(name, raising=False)
    for name, value in display.items():
        monkeypatch.setenv(name, value)
    env = gymnasium.make("QuadSafe/Avoid-v0", render_mode="human", conditions=conditions)
    for first_frame in (env.reset, env.reset, lambda: setattr(env.unwrapped, "state", env.unwrapped.state)):
        with pytest.raises(OSError, match=r"^render_mode 'human' must have a display to open a window on, got"):
            first_frame()
    assert not pygame.display.get_init()
    env.close()


def test_nobody_sees_a_dummy(screen, monkeypatch):
    monkeypatch.setenv("DISPLAY", ":0")
    assert not has_display() and not pygame.display.get_init()


def test_readings_outlive_the_window_of_another_env():
    before = picture()
    pygame.quit()
    np.testing.assert_array_equal(picture(), before)


def test_no_display_is_touched_and_no_greeting_is_printed():
    code = (
        "import gymnasium, quadsafe_env\n"
        "env = gymnasium.make('QuadSafe/Avoid-v0', render_mode='rgb_array')\n"
        "env.reset(seed=0); env.render()\n"
        "import pygame; print(pygame.display.get_init())"
    )
    environment = {
        k: v for k, v in os.environ.items() if not k.startswith(("DISPLAY", "WAYLAND", "SDL", "PYGAME"))
    }
    outcome = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    assert outcome.stdout.split() == ["False"] and not outcome.stderr
