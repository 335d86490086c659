"""One quadrotor as a ``gymnasium.Env``."""

import math
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray

from quadsafe_core.maths.counter_rng import key_words
from quadsafe_core.shapes import Obstacles
from quadsafe_env.given_state import given_states
from quadsafe_env.plain_spec import PlainSpec
from quadsafe_env.plant_access import PlantAccess
from quadsafe_env.settings import (
    RENDER_MODES,
    action_array,
    build_world,
    check_begun,
    check_keywords,
    check_render_mode,
    known_options,
    scene_integer,
)
from quadsafe_env.simulation.surroundings import copied_row
from quadsafe_env.simulation.world import World
from quadsafe_env.tasks.way import corners_of

ROW = np.zeros(1, dtype=np.intp)


class QuadrotorEnv(PlainSpec, PlantAccess, gymnasium.Env):
    """A quadrotor with thrust dynamics, (29) of the paper, among obstacles that it collides with.

    ### Action: Box(−1, 1, (4,), float32)
    Entries beyond ±1 are clipped. A non-finite action raises ValueError, unless the env is shielded.

    | `action=`    | entries 0–2 at 1                     | entry 3 at 1                      |
    |--------------|--------------------------------------|-----------------------------------|
    | `"velocity"` | velocity 2 m/s along world x, y, z   | yaw rate 2 rad/s                  |
    | `"snap"`     | snap 200 m/s⁴ along world x, y, z    | yaw acceleration 10 rad/s²        |
    | `"wrench"`   | F_z, τ_x, τ_y                        | τ_z; all as `snap` gives at hover |
    | `"rates"`    | thrust, then ω_x and ω_y of 6 rad/s  | ω_z of 2 rad/s                    |
    | `"attitude"` | thrust, then roll and pitch of 30°   | ω_z of 2 rad/s                    |

    The thrust of these is the collective beyond hover over mass; 1 is half of the shorter way from hover to the
    thrust floor and to full thrust. ``quadsafe_env.vehicle.actions`` has the feedback laws.

    `action_scale` has the numbers. The action is held for one policy step; the desired snap it becomes is
    computed, filtered and handed to the inner loop once per control period.

    ### Observation: Box(−1, 1, (15 + 5 k,), float32), in Rooms and Gates (15 + 7 k,)

    | entries | meaning                                                    | 1 stands for (saturates) |
    |---------|------------------------------------------------------------|--------------------------|
    | 0–2     | goal − r, or the centre of the next opening − r            | 4 m                      |
    | 3–5     | ṙ                                                          | 4 m/s                    |
    | 6–8     | r̈                                                          | 20 m/s²                  |
    | 9–11    | r⃛                                                          | 200 m/s³                 |
    | 12–13   | cos and sin of the yaw angle (1, 0 with nose upright)      | exact                    |
    | 14      | ω_z                                                        | 10 rad/s                 |
    | then, for each of the k nearest obstacles (k = 1; Forest 8), zeros when there are fewer:              |||
    | +0–2    | nearest point of its core − r; of a sphere its centre − r  | 4 m                      |
    | +3      | distance to keep from its core: a sphere's keep-out radius | 2 m                      |
    | +4      | 1 if there is such an obstacle                             | exact                    |
    | in Rooms and Gates, for each of the 8 nearest, for all shapes alike, all times its nearness:          |||
    | +0–2    | nearest point of its keep-out surface − r                  | 4 m                      |
    | +3–5    | unit normal of that surface there, away from it            | exact                    |
    | +6      | the nearness: 1 on that surface and in it, 0 from 1 m on   | exact                    |

    The core of a capsule is its segment, that of a box the box itself. Inside a keep-out surface the way to its
    nearest point is the way out. Nearest is by signed distance; of equals the first given.

    ### Obstacles
    What the task draws, or `obstacles=`: spheres, capsules, cylinders, boxes, hulls of points, ellipsoids and
    half-spaces (``quadsafe_core.shapes``), at rest or at a constant velocity, which moves them in every physics
    step from the beginning of the episode on. `bounds=(low, high)` are six walls more. The vehicle is a ball of
    radius `params.radius` about r; start and goal are redrawn until they are 0.15 m clear of what was given,
    where it is at the beginning. Among `obstacles=` the straight way between them is blocked in at least the
    share `blocked=` of scenes, by default half, or a warning tells the share found; `start=` and `goal=` are
    points, boxes or lists in place of the task's own. `is_blocked` says how it is in this scene. The property
    `obstacles` is what there is now, a copy: iterating gives the shapes; `keep_out` is the vehicle's radius,
    which `radius` holds.

    ### Reward
    Distance gained towards the goal (m) − 0.005 ‖action‖² + 2 once, on arrival: within 0.10 m of the goal for
    0.5 s without a break. A collision costs nothing here: it is `info["cost"]`.
    Track pays 0.1/(1 + e/0.3 m) − 0.005 ‖action‖² for the distance e from the reference.

    ### Track
    The goal is where the reference is now. Behind the entries above, of its 4 nearest spheres, the agent sees
    12 more: velocity of the reference − ṙ (4 m/s), and the reference 0.2, 0.4 and 0.8 s later − r (4 m). The
    info has `tracking_error`, and `rms_error` and `max_error` of the episode so far, m. `is_success` is an
    episode without a violation whose `rms_error` is at most 0.5 m; it is flown to the time limit.

    ### Your own observation and reward
    `observation="world"`, `observation=(function, space)` and `reward=function` stand in place of these, with
    functions of ``quadsafe_env.signals.quantities.Quantities``, the same in the vector env.

    ### Openings
    In Rooms and Gates the vehicle must fly through openings, in order, before the goal counts. Until then the
    agent sees where the next one is in place of the goal, and distance is counted along the way: to the centre
    of the next, from there to the one after it, and so on to the goal. One is passed where the flight crosses
    its plane, forwards and between its edges. `way` has the corners of a way that is free by construction.

    ### Start and end
    A scene is a function of a 64-bit integer: `reset(seed=s)` flies scene s, later resets hash (s, episode),
    `reset(options={"scene": k})` flies scene k. Starts are at rest, clear of every obstacle. An episode ends
    with a violation (`terminate_on_violation=False` flies on), out of bounds, at a crash of the model (thrust
    at its floor or a non-finite state), and, but for Flight, on arrival. The env never truncates itself:
    `truncated` is the time limit that `gym.make` adds, and nothing else.

    ### Info, the same keys at reset and at every step
    | key                                  | meaning                                                          |
    |--------------------------------------|------------------------------------------------------------------|
    | `cost`                               | 1.0 if `clearance` is negative                                   |
    | `clearance`                          | least signed distance of the vehicle's ball to an obstacle over  |
    |                                      | the physics substeps, m; negative inside, inf without any        |
    | `is_success`                         | arrived, without a violation in this episode                     |
    | `violation`, `out_of_bounds`, `crash`| what this step did; a crash leaves the last sound state          |
    | `invalid_action`                     | the action was not finite                                        |
    | `saturated`                          | a rotor was clipped at a physics substep; False without limits   |
    | `spinning`                           | ω_z was beyond its range at a control instant of this step       |

    ### Yaw
    In every interface |ω_z| is kept to the vehicle's `yaw_rate_max` (10 rad/s by default) and to 0.02
    rad in a physics step, and ω̇_z to 40 rad/s² at 500 Hz (``quadsafe_env.vehicle.yaw``). A state set beyond
    that comes back.

    ### Rotor limits
    By default the rotors give whatever thrust and torque the snap asks for. With
    `rotor_limits=True` each keeps to [0, thrust_max/4], as told in ``quadsafe_env.vehicle.rotors``, and the yaw
    motion to |ω_z| <= 2 rad/s and a yaw acceleration that the rotors can give. Within `authority()` no rotor is
    clipped.

    ### Real conditions
    By default the estimate is exact and every answer of the filter is flown at once, in
    still air, by the modelled vehicle. `conditions=` switches on noise, bias, delay, loss, wind, drag, wrong
    models, lag, jitter and impulses; ``quadsafe_env.tasks.conditions`` has the fields. Policy and filter then
    see an estimate, while reward, cost and info stay true. ``conditions`` says what is on. With
    `lag_compensation="told"` the inner loop counts the rotors' lag.

    ### Plants that others wrote
    `plant="mujoco"`, or another of ``quadsafe_env.plants``, flies in place of this model; all else is as above,
    but that it holds its heading: entry 3 of an action asks for nothing. ``plant`` is it, None here.

    ### Keywords
    See ``quadsafe_env.settings.build_worlds``.

    ### Versions
    v0: first.
    """

    _world: World

    metadata = {"render_modes": list(RENDER_MODES), "render_fps": 25}  # noqa: RUF012 - Gymnasium's attribute

    def __init__(self, *, render_mode: str | None = None, **settings: Any):
        check_keywords("gymnasium.make", settings, ("render_mode",))
        self.render_mode = check_render_mode(render_mode, RENDER_MODES)
        self._world = build_world(1, self.render_mode, True, **settings)
        self.metadata = {**self.metadata, "render_fps": self._world.rates.policy}
        self.action_space = Box(-1.0, 1.0, (4,), np.float32)
        self.observation_space = self._world.observation_space
        self._is_seeded = False

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        """Start an episode.

        Args:
            seed: the scene of this episode and the source of the later ones.
            options: {"scene": k} flies scene k, an integer in [0, 2^64).

        Raises:
            TypeError, ValueError: for a seed or scene out of range, or another option.
        """
        first = None if seed is None else scene_integer("seed", seed)
        given = known_options(options, ("scene",))
        scene = scene_integer("scene", given["scene"]) if "scene" in given else None
        super().reset(seed=first)
        if first is not None or not self._is_seeded:
            self._world.seed(ROW, key_words(int(self.np_random.integers(2**63)) if first is None else first))
            self._is_seeded = True
        if scene is not None:
            self._world.reset_to(ROW, key_words(scene))
        else:
            self._world.reset(ROW)
        return self._world.observed()[0], self._world.outcome_of_one()[2]

    def step(self, action: ArrayLike):
        """Fly one policy step.

        Raises:
            TypeError, ValueError: for no numbers, a wrong shape, or a non-finite action without a shield.
            gymnasium.error.ResetNeeded: before the first reset.
        """
        check_begun(self._is_seeded)
        row = action_array("action", action, (4,))
        if not self._world.is_shielded and not math.isfinite(sum(row.tolist())):
            raise ValueError(f"action must be finite, got {row.tolist()}")
        observation = self._world.step(row.reshape(1, 4))[0]
        reward, terminated, info = self._world.outcome_of_one()
        return observation, reward, terminated, False, info

    def render(self):
        """A frame (render_size, render_size, 3) in the mode "rgb_array", else None: "human" shows by itself."""
        return self._world.picture(0) if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Close the window of the mode "human", and a plant that others wrote."""
        self._world.close()

    def flat_state(self) -> NDArray[np.float64]:
        """Flat state (4, 3): r, ṙ, r̈, r⃛ in the world frame."""
        return self._world.flat_states()[0]

    @property
    def state(self) -> NDArray[np.float64]:
        """The plant's state (20,), a copy; see ``quadsafe_env.vehicle.state``.

        Setting it starts the episode over from there, in the present scene; the time limit runs on. What the
        model cannot fly from is refused: ``quadsafe_env.given_state.given_states``.
        """
        return self._world.states[0].copy()

    @state.setter
    def state(self, value: ArrayLike) -> None:
        self._world.start_from(given_states(value, (), self._world))

    @property
    def goal(self) -> NDArray[np.float64]:
        """The goal (3,), m, a copy."""
        return self._world.scenes.goal[0].copy()

    @property
    def reference(self) -> NDArray[np.float64]:
        """In Track, position to snap of the reference now, (5, 3), SI; an error elsewhere."""
        return self._references()[0]

    @property
    def is_blocked(self) -> bool:
        """Whether the straight way from start to goal is blocked, see ``quadsafe_env.tasks.ends``."""
        return bool(self._world.blocked_ways()[0])

    @property
    def way(self) -> NDArray[np.float64]:
        """The corners (W, 3) of a way from start to goal, m, free by construction in rooms and gates.

        ``quadsafe_env.tasks.rooms`` and ``quadsafe_env.tasks.gates`` say what it keeps clear of. Elsewhere it
        is the straight one, whatever is in it.
        """
        scenes = self._world.scenes
        return corners_of(scenes.start[0], self._world.openings[0], scenes.goal[0])

    @property
    def obstacles(self) -> Obstacles:
        """What there is as it stands now, a copy; iterating gives the shapes, without ``keep_out``."""
        return copied_row(self._world.obstacles, 0)
