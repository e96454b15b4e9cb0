"""RemoteEnv: worlds of a service as the rows of a gymnasium vector environment, to train from afar.

    env = dohyo.RemoteEnv("http://127.0.0.1:8000", num_envs=2, benchmark="quickstart", mission="right-to-south")
    observations, _ = env.reset(seed=0)
    observations, rewards, terminations, truncations, infos = env.step(actions)

Each row is a world of its own, which stays from episode to episode. The requests of all rows are sent before any answer
is read, so that their simulations run at the same time.
"""

from __future__ import annotations

import contextlib
import logging
import os
import re
import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final
from urllib.parse import parse_qs, urlsplit, urlunsplit

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict
from numpy.typing import NDArray

from dohyo.service.client.connection import UnreachableError, WireError
from dohyo.service.client.pending import PendingConnection
from dohyo.service.wire.messages import Format, arrays, pack
from dohyo.sumo_networks.ego.control import make_control
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.envs.env_rows import Observations
from dohyo.sumo_networks.envs.local_vector_env import LocalVectorEnv
from dohyo.sumo_networks.envs.options import own_space
from dohyo.sumo_networks.errors import InvalidInputError, SimulationError
from dohyo.sumo_networks.sensors import Track, make_sensors
from dohyo.sumo_networks.units import TICK_S

SENSORS: Final = ("speedometer", "route", "objects")
WORKER: Final = "learner"
CLOSE_S: Final = 10.0  # the time in which an environment that closes insists on ending its world
LIMIT: Final = re.compile(r"at most (\d+) live worlds of one owner")
"""In the words of a service that refuses one more world."""
_OPTIONS: Final = ("benchmark", "mission", "sensors", "control", "reward")


logger = logging.getLogger("dohyo.remote_env")


@dataclass(frozen=True)
class RemoteWorlds:
    """Which worlds a `RemoteEnv` makes, and how it drives in them.

    Attributes:
        url: Address of the service.
        token: Token with the role submitter.
        world: Order of a world, as `POST /v1/worlds` takes it.
        ego: Name of the ego that is driven; None: the first one. The autopilot drives the others.
        sensors: Its sensors.
        control: Its control.
        rows: How many of them there are at once.
    """

    url: str
    token: str
    world: Mapping[str, Any]
    ego: str | None
    sensors: tuple[str, ...]
    control: str
    rows: int = 1

    def check_room(self, refusal: WireError) -> None:
        """Refuses what waiting cannot bring about: more worlds than one owner may have.

        Raises:
            InvalidInputError: The rows of this environment fill the limit.
        """
        limit = LIMIT.search(refusal.detail)
        if limit is not None and int(limit[1]) < self.rows:
            raise InvalidInputError(
                f"num_envs: {self.rows} rows are as many worlds, and the service has at most {limit[1]} for one owner; "
                "its DOHYO_WORLDS_PER_OWNER says how many"
            )


class RemoteEnv(LocalVectorEnv):
    """N rows, each an ego in a world of its own at a service; see `RowVectorEnv`.

    An observation has a vector of float32 for each sensor, and pictures as they are. An episode terminates when the
    reward function says so or at the goal, and is truncated when the world says so otherwise. A row whose world is
    gone, such as after a restart of the service, or was reset by somebody else, is truncated and "lost". Its next reset
    makes a new world.
    """

    def __init__(
        self,
        url: str,
        num_envs: int = 1,
        *,
        token: str | None = None,
        benchmark: str | None = None,
        mission: str | None = None,
        scenario: Mapping[str, Any] | None = None,
        ego: str | None = None,
        sensors: Sequence[str] = SENSORS,
        control: str = "target_speed_steering",
        reward: str = "roach",
    ) -> None:
        """Checks the names; the worlds are made at the first reset.

        Args:
            url: Address of the service. Its query may have the options too, such as `?benchmark=quickstart`.
            num_envs: Number of worlds; the service limits them by owner (`DOHYO_WORLDS_PER_OWNER`, by default 2).
            token: Token with the role submitter; None: the environment variable DOHYO_TOKEN.
            benchmark: Name of a benchmark of drives; "quickstart" where there is no scenario.
            mission: One of its scenarios; None: the first one.
            scenario: A scenario of your own, instead of a benchmark.
            ego: Ego to drive; None: the first one.
            sensors: Names of sensors.
            control: Name of a control interface.
            reward: Name of a reward function.

        Raises:
            InvalidInputError: A name is unknown, or the address.
        """
        address, options = _split(url)
        given: dict[str, Any] = {"benchmark": benchmark, "mission": mission, "sensors": sensors, "control": control}
        given |= {"reward": reward} | options
        names = tuple(given["sensors"])
        made = make_sensors(names, Track.PRIVILEGED)
        spaces: dict[str, gymnasium.Space[Any]] = {sensor.name: _vector_of(own_space(sensor.space)) for sensor in made}
        actions = own_space(make_control(given["control"], VehicleParameters(), TICK_S).space)
        world: dict[str, Any] = {"reward": given["reward"], "stays": True, "deadline_s": 600}
        if scenario is None:
            world |= {"benchmark": given["benchmark"] or "quickstart", "mission": given["mission"]}
        else:
            world["scenario"] = dict(scenario)
        token = token or os.environ.get("DOHYO_TOKEN", "")
        plan = RemoteWorlds(address, token, world, ego, names, given["control"], num_envs)
        self._worlds: dict[int, RemoteWorld] = {}

        def make(rank: int) -> RemoteWorld:
            return self._worlds[rank]

        self._plan_of_worlds = plan
        super().__init__(make, num_envs, Dict(spaces), actions)

    def _send(self, group: int, command: str, *arguments: Any) -> None:
        super()._send(group, command, *arguments)
        if command == "reset":
            if group not in self._worlds:
                spaces = self.single_observation_space, self.single_action_space
                self._worlds[group] = RemoteWorld(self._plan_of_worlds, *spaces)
            self._worlds[group].begin_reset(arguments[0])
        elif command == "step":
            self._worlds[group].begin_step(self._arrays.actions[group])

    def _discard(self, group: int) -> None:
        super()._discard(group)
        self._worlds.pop(group, None)


class RemoteWorld(gymnasium.Env[Observations, NDArray[Any]]):
    """One world; a reset and a step each consist of a request, which `begin_...` sends, and of its answer."""

    def __init__(self, plan: RemoteWorlds, observations: Dict, actions: gymnasium.Space[Any]) -> None:
        """Connects at the first reset."""
        self.action_space, self._spaces = actions, observations
        self._plan, self._http = plan, PendingConnection(plan.url)
        self._key = secrets.token_hex(16)
        self._id = self._seat = self._seat_token = self._ego = ""
        self._tick = 0
        self._run: dict[str, int] = {}
        self._told = False
        self._seen: Observations = {}

    def begin_reset(self, seed: int | None) -> None:
        """Asks for a new world, or for a new beginning of the one that there is."""
        if self._id:
            self._ask_for_reset(seed)
        else:
            order = {key: value for key, value in self._plan.world.items() if value is not None}
            self._http.send("POST", "/v1/worlds", self._plan.token, order, key=self._key)

    def _ask_for_reset(self, seed: int | None) -> None:
        asked = {} if seed is None else {"seed": seed % 2**31}
        self._http.send("POST", f"/v1/worlds/{self._id}/reset", self._plan.token, asked)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, Any]]:
        """Waits for the first tick.

        Raises:
            InvalidInputError: The service refuses the world, or the rows are more than an owner may have.
            SimulationError: The world or the service is gone.
        """
        with _as_lost():
            answer = self._http.receive(busy=None if self._id else self._wait_for_room)
            if not self._id:
                self._join(answer)
                self._ask_for_reset(seed)  # so that the first episode follows from its seed as all others do
                self._http.receive()
            self._http.send("GET", f"/v1/seats/{self._seat}", self._seat_token)
            self._take(self._http.receive())
        return self._seen, {}

    def _wait_for_room(self, refusal: WireError) -> None:
        """Tells once why there is no world yet."""
        self._plan.check_room(refusal)
        if not self._told:
            logger.warning("waits for a world: %s", refusal)
        self._told = True

    def _join(self, world: Mapping[str, Any]) -> None:
        plan = self._plan
        self._id, self._ego = world["id"], plan.ego or world["egos"][0]["name"]
        asked = {"name": WORKER, "egos": [self._ego], "track": "privileged"}
        asked |= {"sensors": list(plan.sensors), "control": plan.control}
        self._http.send("POST", f"/v1/worlds/{self._id}/join", plan.token, asked)
        seated = self._http.receive()
        self._seat, self._seat_token = seated["seat"], seated["token"]
        self._http.send("POST", f"/v1/worlds/{self._id}/resume", plan.token, {})
        self._http.receive()

    def begin_step(self, action: NDArray[Any]) -> None:
        """Sends an action."""
        body = {"tick": self._tick, **self._run, "actions": {self._ego: pack(np.asarray(action))}}
        self._http.send("POST", f"/v1/seats/{self._seat}/step", self._seat_token, body, Format.MSGPACK)

    def step(self, action: NDArray[Any]) -> tuple[Observations, float, bool, bool, dict[str, Any]]:
        """Waits for the next tick.

        Raises:
            SimulationError: The world or the service is gone.
        """
        with _as_lost():
            answer = self._http.receive()
        outcome = answer.get("outcomes", {}).get(self._ego)
        if outcome is None:
            raise SimulationError(f"ego '{self._ego}' has no outcome of this tick: its world has ended or begun anew")
        self._take(answer)
        terminated = bool(outcome["terminated"])
        truncated = bool(answer["done"]) and not terminated
        infos = {"success": outcome["success"]} if terminated or truncated else {}
        return self._seen, outcome["reward"], terminated, truncated, infos

    def _take(self, answer: Mapping[str, Any]) -> None:
        self._tick = answer["tick"]
        self._run = {"resets": answer["resets"]} if "resets" in answer else {}  # an older service knows none
        seen = arrays(answer["observations"]).get(self._ego, {})
        spaces = self._spaces
        self._seen = self._seen | {name: _fitted(array, spaces[name]) for name, array in seen.items()}

    def close(self) -> None:
        """Ends the world and deletes it, as far as the service can be reached."""
        with contextlib.suppress(UnreachableError):
            if self._id:
                with contextlib.suppress(WireError):  # it may have ended
                    self._ask_to_close("POST", f"/v1/worlds/{self._id}/end")
                with contextlib.suppress(WireError):
                    self._ask_to_close("DELETE", f"/v1/worlds/{self._id}")
        self._http.close()

    def _ask_to_close(self, method: str, path: str) -> None:
        self._http.send(method, path, self._plan.token, {})
        self._http.receive(CLOSE_S)


@contextlib.contextmanager
def _as_lost() -> Any:
    """Refusals of what was asked stay errors of the caller; all else is the loss of a world."""
    try:
        yield
    except UnreachableError as error:
        raise SimulationError(str(error)) from error
    except WireError as error:
        if error.status in (401, 404, 409, 410) or error.status >= 500:
            raise SimulationError(str(error)) from error
        raise InvalidInputError(str(error)) from error


def _split(url: str) -> tuple[str, dict[str, Any]]:
    """Address without its query, and the options in it."""
    parts = urlsplit(url)
    options: dict[str, Any] = {name: values[-1] for name, values in parse_qs(parts.query).items()}
    if unknown := sorted(options.keys() - set(_OPTIONS)):
        raise InvalidInputError(f"'{url}': expected options {', '.join(_OPTIONS)}, got {', '.join(unknown)}")
    if "sensors" in options:
        options["sensors"] = options["sensors"].split(",")
    return urlunsplit(parts._replace(query="", fragment="")), options


def _vector_of(space: Box) -> Box:
    """Space of a sensor as a row has it: pictures as they are, all else as one vector of float32."""
    if space.dtype == np.uint8:
        return space
    return Box(space.low.astype(np.float32).ravel(), space.high.astype(np.float32).ravel(), dtype=np.float32)


def _fitted(array: NDArray[Any], space: gymnasium.Space[Any]) -> NDArray[Any]:
    return array.astype(space.dtype).reshape(space.shape)
