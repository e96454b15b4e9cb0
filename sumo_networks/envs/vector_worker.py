"""Worker of a VectorDrivingEnv: a process with one DrivingEnv, which steps on request."""

from __future__ import annotations

import pickle
import signal
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection

from gymnasium.vector import AutoresetMode

from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.envs.vector_memory import SharedMemory, WorkerPipe
from dohyo.sumo_networks.errors import InvalidInputError, SimulationError
from dohyo.sumo_networks.scenario import Scenario
from dohyo.sumo_networks.seeds import training_seed
from dohyo.sumo_networks.sensors import SensorConfig

ScenarioSource = Sequence[Scenario] | Callable[[int], Scenario]

RESET, STEP, RENDER = b"reset", b"step", b"render"


@dataclass(frozen=True, slots=True)
class Plan:
    """Settings of a worker, sent once."""

    scenarios: ScenarioSource
    sensors: tuple[str | SensorConfig, ...]
    control: str
    reward: str | None
    render_mode: str | None
    envs: int
    autoreset: AutoresetMode

    def scenario(self, episode: int, egos: int) -> Scenario:
        """Scenario of an episode; InvalidInputError if its number of egos differs from the first one's."""
        if not callable(self.scenarios):
            return self.scenarios[episode % len(self.scenarios)]
        scenario = self.scenarios(episode)
        if len(scenario.missions) != egos:
            raise InvalidInputError(
                f"scenario of episode {episode}: expected {egos} egos, got {len(scenario.missions)}"
            )
        return scenario


class VectorWorker:
    """One environment in its worker, and its rows of the shared memory."""

    def __init__(self, memory: SharedMemory, plan: Plan, worker: int) -> None:
        self.plan, self.worker, self.arrays = plan, worker, memory.arrays()
        arrays = self.arrays
        self.observations = {name: array[worker] for name, array in arrays.observations.items()}
        self.finals = {name: array[worker] for name, array in arrays.finals.items()}
        self.actions, self.rewards = arrays.actions[worker], arrays.rewards[worker]
        self.terminations, self.truncations = arrays.terminations[worker], arrays.truncations[worker]
        self.active = arrays.active[worker]
        self.env: DrivingEnv | None = None

    def reset(self) -> None:
        """Starts the episode whose number is in the shared memory."""
        episode = int(self.arrays.episode[self.worker])
        scenario = self.plan.scenario(episode, len(self.active))
        seed = training_seed(int(self.arrays.seed[0]), episode)
        if self.env is None or self.env.scenario != scenario.model_copy(update={"seed": self.env.scenario.seed}):
            self.close()
            plan = self.plan
            self.env = DrivingEnv(scenario, plan.sensors, plan.control, plan.reward, plan.render_mode)
        observations, _ = self.env.reset(seed=seed)
        self.arrays.renewed[self.worker] = False
        self._clear()
        self.active[:] = True
        self._write(observations)

    def step(self) -> None:
        """Advances one tick; starts the next episode in the tick that ends one, or instead of the tick after it."""
        env = self.env
        if env is None:
            raise SimulationError(f"environment {self.worker} has not been reset")
        self._clear()
        names = env.possible_agents
        actions = {name: self.actions[ego] for ego, name in enumerate(names) if name in env.agents}
        if not actions:
            if self.plan.autoreset is AutoresetMode.NEXT_STEP:
                self._begin_next()
            return
        observations, rewards, terminations, truncations, _ = env.step(actions)
        for ego, name in enumerate(names):
            if name in actions:
                self.active[ego], self.rewards[ego] = True, rewards[name]
                self.terminations[ego], self.truncations[ego] = terminations[name], truncations[name]
        self._write(observations)
        if not env.agents and self.plan.autoreset is AutoresetMode.SAME_STEP:
            self._renew()

    def render(self) -> None:
        """Draws the last tick into the shared memory."""
        if self.env is None:
            raise SimulationError(f"environment {self.worker} has not been reset")
        frame = self.env.render()
        assert frame is not None  # the parent sends the command only with a render mode
        self.arrays.frames[self.worker] = frame

    def close(self) -> None:
        """Closes the worker's environment, if there is one."""
        if self.env is not None:
            self.env.close()
            self.env = None

    def _renew(self) -> None:
        """Starts the next episode; the shared rewards and ends stay those of the last tick."""
        for name, array in self.observations.items():
            self.finals[name][...] = array
        ended = self.rewards.copy(), self.terminations.copy(), self.truncations.copy(), self.active.copy()
        self._begin_next()
        self.rewards[:], self.terminations[:], self.truncations[:], self.active[:] = ended
        self.arrays.renewed[self.worker] = True

    def _begin_next(self) -> None:
        self.arrays.episode[self.worker] += self.plan.envs
        self.reset()

    def _clear(self) -> None:
        self.arrays.renewed[self.worker] = False
        for array in (self.active, self.terminations, self.truncations, self.rewards):
            array[:] = 0
        if len(self.active) > 1:  # a single ego's observation is written whole
            for observation in self.observations.values():
                observation[:] = 0.0

    def _write(self, observations: Mapping[str, Mapping[str, Float32Array]]) -> None:
        assert self.env is not None
        for ego, name in enumerate(self.env.possible_agents):
            for sensor, value in observations.get(name, {}).items():
                self.observations[sensor][ego] = value


def work(pipe: Connection, memory: SharedMemory, plan: Plan, worker: int) -> None:
    """Main function of a worker process: carries out commands until the parent closes the pipe or dies."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles Ctrl-C
    channel, seat = WorkerPipe(pipe), VectorWorker(memory, plan, worker)
    commands = {RESET: seat.reset, STEP: seat.step, RENDER: seat.render}
    try:
        while True:
            command = channel.receive()
            try:
                commands[command]()
                answer = b""
            except Exception as error:
                answer = packed(error)
            channel.send(answer)
    except (EOFError, OSError):
        seat.close()


def packed(error: Exception) -> bytes:
    """Pickles class, arguments and traceback of an error; not the error, whose constructor may need other arguments."""
    trace = "".join(traceback.format_exception(error))
    try:
        return pickle.dumps((type(error), error.args, trace))
    except Exception:  # the arguments of an unknown error may not be picklable
        return pickle.dumps((SimulationError, (f"{type(error).__name__}: {error}",), trace))


def unpacked(message: bytes, worker: int) -> Exception:
    """Unpickles a worker's error, with the worker's traceback as a note."""
    kind, args, trace = pickle.loads(message)
    error: Exception = kind.__new__(kind, *args)
    error.args = args
    error.add_note(f"in worker {worker}:\n{trace}")
    return error
