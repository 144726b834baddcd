"""The attempt of the planner from one start: its result, and its computing times."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from ocptip.motion.check import MotionCheck
from ocptip.motion.objective import Objective
from ocptip.motion.planner.exact import Refiner
from ocptip.trajectories.trajectory import Trajectory

LEFT_OUT = "left out: other starts promise a lower cost"


@dataclass(frozen=True)
class StartResult:
    """The result of one start, in numbers.

    Attributes:
        number: of the start; with the seed it decides the random motion.
        status: "verified", or what is missing.
        energy: J, NaN if no motion came out.
        verified: the motion keeps all limits on the dense grid.
        iterations: of Ipopt, all solves together.
        seconds: wall time.
        cpu_seconds: CPU time of its thread, which other work on the machine disturbs less.
        solves: number of programs solved.
        stages: CPU seconds by stage: start, coarse, fine, exact, check, proof.
        hops: how often its motion was changed at random and solved again.
    """

    number: int
    status: str
    energy: float
    verified: bool
    iterations: int
    seconds: float
    cpu_seconds: float
    solves: int
    stages: dict[str, float]
    hops: int = 0

    def after(self, *parts: StartResult) -> StartResult:
        """This one, with what all these parts took together."""
        names = "iterations", "seconds", "cpu_seconds", "solves", "hops"
        stages: dict[str, float] = {}
        for part in parts:
            for name, seconds in part.stages.items():
                stages[name] = stages.get(name, 0.0) + seconds
        return replace(
            self, stages=stages, **{name: sum(getattr(part, name) for part in parts) for name in names}
        )


@dataclass(frozen=True, eq=False)
class Rough:
    """A start after its first smooth program.

    Attributes:
        number: of the start.
        coarse, x: variables after the coarse program, and the last ones; None if there are none.
        cost: about that of the motion, slowed down where acceleration steps count; infinite if there is none.
        status: what is missing; empty if nothing is.
        clock: what it took.
    """

    number: int
    coarse: np.ndarray | None
    x: np.ndarray | None
    cost: float
    status: str
    clock: Clock

    @classmethod
    def failed(cls, number: int, status: str, clock: Clock | None = None) -> Rough:
        """A start without motion."""
        return cls(number, None, None, np.inf, status, clock or Clock())

    @property
    def left_out(self) -> Attempt:
        """The start, given up here."""
        return Attempt(self.clock.result(self.number, self.status or LEFT_OUT, None), None, None)


@dataclass(frozen=True, eq=False)
class Attempt:
    """The result of one start with its motion and check.

    Attributes:
        result: in numbers.
        motion, check: both None if no motion came out.
        slower: factor of all its times that made its proof complete.
    """

    result: StartResult
    motion: Trajectory | None
    check: MotionCheck | None
    slower: float = 1.0

    def cost(self, objective: Objective) -> float:
        """Cost of the motion; infinite unless it is verified."""
        if self.check is None or not self.check.verified:
            return np.inf
        return objective.cost(self.check.energy, self.check.duration)

    def after(self, before: Attempt, *parts: Attempt) -> Attempt:
        """This one, with what all these took together."""
        return replace(self, result=self.result.after(before.result, *(part.result for part in parts)))


class Clock:
    """Adds up CPU time of the thread by stage, wall time, iterations and solves."""

    def __init__(self) -> None:
        self.stages: dict[str, float] = {}
        self.iterations = self.solves = 0
        self.seconds = self.cpu_seconds = 0.0
        self.go_on()

    def go_on(self) -> None:
        """From here on, perhaps in another thread."""
        self.began = time.perf_counter(), time.thread_time()
        self.last = self.began[1]

    def pause(self) -> None:
        """Count no further."""
        self.seconds += time.perf_counter() - self.began[0]
        self.cpu_seconds += time.thread_time() - self.began[1]

    def stage(self, name: str) -> None:
        """A stage of that name has ended."""
        now = time.thread_time()
        self.stages[name] = self.stages.get(name, 0.0) + now - self.last
        self.last = now

    def count(self, refiner: Refiner) -> None:
        """Add the iterations and solves of its programs."""
        self.iterations += refiner.iterations
        self.solves += refiner.solves

    def result(self, number: int, status: str, checked: MotionCheck | None) -> StartResult:
        """Result of a start, with its computing times."""
        return StartResult(
            number=number,
            status=status,
            energy=checked.energy if checked else float("nan"),
            verified=bool(checked and checked.verified),
            iterations=self.iterations,
            seconds=self.seconds,
            cpu_seconds=self.cpu_seconds,
            solves=self.solves,
            stages=self.stages,
        )
