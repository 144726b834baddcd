"""Mass and centre of mass of payload and base, from a sensor in the base or the loads of feet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError, positive_number
from ocptip.measured.estimate import Estimate, Ran, estimate
from ocptip.measured.parameters import (
    PER_BODY,
    link_parameters,
    moved_parameters,
    on_sensor,
    parameters_of,
    process_loads,
    regressors,
)
from ocptip.measured.prediction import Predictor
from ocptip.measured.recording import FOOT, WRENCH, Recording
from ocptip.numerics.threads import one_thread
from ocptip.robots.payload import Payload

BASE, PAYLOAD = "base", "payload"
_FLAT = 1e-6  # m, and sine of an angle: of feet in one plane


@dataclass(frozen=True, eq=False)
class IdentifiedBody:
    """Mass and centre of mass.

    Attributes:
        name: "payload" or "base".
        mass: kg.
        center: (3,), m: gripper or base axes; nominal where it is not seen.
        covariance: (4, 4) of mass and centre.
        seen: (4,) False where the recording does not tell it.
        quantile: half widths of 95 % intervals over standard errors.
    """

    name: str
    mass: float
    center: np.ndarray
    covariance: np.ndarray
    seen: np.ndarray
    quantile: float

    @property
    def errors(self) -> np.ndarray:
        """(4,) standard errors; infinite where nothing is seen."""
        return np.where(self.seen, np.sqrt(np.diag(self.covariance)), np.inf)

    def to_table(self) -> dict[str, Any]:
        """Keys of the table `[payload]` or `[base]` of a task file."""
        return {"mass": self.mass, "center_of_mass": self.center.tolist()}

    def tolerance(self, sigmas: float) -> dict[str, Any]:
        """Keys of the table `[tolerance]`: this number of standard errors on both sides; no key for what is
        not seen.

        Raises:
            InputError: the mass may be zero.
        """
        half = np.where(self.seen, positive_number("sigmas", sigmas) * np.sqrt(np.diag(self.covariance)), 0.0)
        if half[0] >= self.mass:
            raise InputError(
                f"{self.name}: mass {self.mass:.4g} +- {half[0]:.2g} kg may be zero; record longer motions"
            )
        keys = {
            BASE: ("base_mass", [self.mass - float(half[0]), self.mass + float(half[0])], "center_of_mass"),
            PAYLOAD: ("payload_mass", float(half[0]) / self.mass, "payload_center"),
        }
        mass, value, center = keys[self.name]
        return {mass: value, center: half[1:].tolist()}

    def to_dict(self) -> dict[str, Any]:
        """Plain data, SI units."""
        return {
            **self.to_table(),
            "covariance": self.covariance.tolist(),
            "seen": self.seen.tolist(),
            "confidence_95": (self.quantile * self.errors).tolist(),
        }


@dataclass(frozen=True, eq=False)
class Bodies:
    """The bodies that were identified.

    Attributes:
        bodies: in the order asked for.
        estimate: of all parameters.
        source: "sensor" or "feet".
    """

    bodies: tuple[IdentifiedBody, ...]
    estimate: Estimate
    source: str

    def to_dict(self) -> dict[str, Any]:
        """Plain data, SI units."""
        return {
            **{body.name: body.to_dict() for body in self.bodies},
            "source": self.source,
            "residuals": dict(self.estimate.residuals),
            "delays_s": dict(self.estimate.delays),
            "low_pass": {kind: vars(low_pass) for kind, low_pass in self.estimate.low_passes.items()},
        }


@one_thread
def identify_bodies(
    recording: Recording,
    predictor: Predictor,
    names: Sequence[str] = (PAYLOAD,),
    *,
    tared: bool = False,
    bandwidth: float | None = None,
) -> Bodies:
    """Find masses and centres of mass.

    What is not asked for is nominal, such as links, and the payload where only the base is asked for. The
    moments of inertia of the payload are also free. The loads of the feet identify a base, or a sensor on
    which it rests (`WrenchSensor.mass` > 0).

    Args:
        recording: with a force-torque sensor, or with the normal forces of all contacts; if both: the sensor.
        predictor: of the nominal robot and the motion that was run.
        names: "payload", "base" or both.
        tared: the zeros of the sensor or the feet are not known; the base cannot be identified then.
        bandwidth: Hz, cutoff of the low-pass filter of sensor or feet as far as it is known; infinite: they
            are not filtered; None: it is searched.

    Raises:
        InputError: nothing of the kind is recorded, or it cannot tell what is asked for.
    """
    robot = predictor.robot
    source, measured, project = _source(recording, predictor)
    if unknown := [name for name in names if name not in (PAYLOAD, BASE)] or not names:
        raise InputError(f"expected payload or base, got {unknown if names else 'nothing'}")
    if BASE in names and tared:
        raise InputError("base: its weight cannot be separated from the zeros of a tared sensor")
    plate = robot.sensor
    if BASE in names and source == WRENCH and not plate.mass:
        raise InputError(
            "base: does not rest on the sensor ([sensor] mass = 0); record the loads of the feet"
        )
    bare = robot.arm.with_payload(None)
    held = robot.payload or Payload(1e-300)
    rest = robot.support if source == FOOT else plate
    under = parameters_of((rest.mass, np.asarray(rest.center_of_mass), np.zeros((3, 3))))
    links = link_parameters(bare)
    local = {
        PAYLOAD: moved_parameters(
            bare.tool_rotation, bare.offsets[-1] + bare.tool_rotation @ held.center_of_mass
        ),
        BASE: moved_parameters(np.eye(3), np.asarray(rest.center_of_mass))[:, :4],
    }
    first = {
        PAYLOAD: parameters_of((held.mass, np.zeros(3), held.inertia)),
        BASE: np.array([rest.mass, 0.0, 0.0, 0.0]),
    }
    fixed = np.concatenate([np.zeros(PER_BODY) if BASE in names else under, links])
    if PAYLOAD not in names:
        fixed[-PER_BODY:] += local[PAYLOAD] @ first[PAYLOAD]
    places = {PAYLOAD: slice(-PER_BODY, None), BASE: slice(0, PER_BODY)}

    def model(
        kind: str, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, process: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        loads = project(regressors(bare, robot.support.gravity, q, qd, qdd)[1])
        columns = np.concatenate([loads[:, :, places[name]] @ local[name] for name in names], axis=2)
        pushed = project(process_loads(robot, q, process)[1])[:, :, 0]
        return (loads @ fixed + pushed).T, columns.transpose(1, 0, 2)

    ran = Ran(recording, predictor)
    start = np.concatenate([first[name] for name in names])
    searched = {} if bandwidth == np.inf else {source: bandwidth}
    zeros = [source] if tared else []
    result = estimate(ran, {source: measured}, model, start, free_zeros=zeros, bandwidths=searched)
    offset, bodies = 0, []
    for name in names:
        centre = held.center_of_mass if name == PAYLOAD else np.asarray(rest.center_of_mass)
        bodies.append(_body(name, centre, result, offset))
        offset += len(first[name])
    return Bodies(tuple(bodies), result, source)


def _source(recording: Recording, predictor: Predictor) -> tuple[str, np.ndarray, Any]:
    """Kind, values (C, N), and what makes them of wrenches about the base's origin."""
    sensor, support = predictor.robot.sensor, predictor.robot.support
    if seen := recording.of(WRENCH):
        which = [one.index for one in seen]
        return (
            WRENCH,
            np.array([one.values for one in seen]),
            lambda loads: on_sensor(sensor, loads)[:, which],
        )
    feet = recording.of(FOOT)
    if not feet:
        raise InputError(
            "recording: neither a force-torque sensor (fx to mz) nor normal forces (normal1, ...)"
        )
    if len(feet) != len(support.contacts) or len(feet) < 3:
        count = len(support.contacts)
        raise InputError(
            f"recording: normal forces of {len(feet)} contacts, there are {count}; at least three"
        )
    places = np.array([contact.position for contact in support.contacts])
    frames = np.array([contact.frame for contact in support.contacts])
    normal, across = frames[0, :, 0], frames[0, :, 1:]
    if (np.abs((places - places[0]) @ normal) > _FLAT).any() or (
        np.abs(frames[:, :, 0] - normal) > _FLAT
    ).any():
        raise InputError("normal forces tell masses only where all contacts stand in one plane")
    # force along the normal and moments about two axes in the plane; friction has no part in them
    arms = np.cross(places - places[0], normal) @ across
    together = np.column_stack([np.ones(len(places)), arms]).T  # (3, feet)
    basis, upper = np.linalg.qr(together.T)
    point = places[0]

    def project(loads: np.ndarray) -> np.ndarray:
        """By base and arm on the feet; noise of the feet is alike and independent in these three."""
        moment = loads[:, 3:] - np.cross(point, loads[:, :3], axisa=0, axisb=1, axisc=1)
        three = np.concatenate(
            [loads[:, :3].transpose(0, 2, 1) @ normal[:, None], moment.transpose(0, 2, 1) @ across], 2
        )
        return -np.linalg.solve(upper.T, three.transpose(0, 2, 1))

    return FOOT, basis.T @ np.array([one.values for one in feet]), project


def _body(name: str, described: np.ndarray, result: Estimate, offset: int) -> IdentifiedBody:
    """From mass and first moments about the described centre."""
    block = slice(offset, offset + 4)
    mass, moment = float(result.values[offset]), result.values[offset + 1 : offset + 4]
    if not mass > 0:
        raise InputError(f"{name}: {mass:.3g} +- {result.half[offset]:.2g} kg; nothing is seen of it")
    slopes = np.eye(4)
    slopes[1:, 0], slopes[1:, 1:] = -moment / mass**2, np.eye(3) / mass
    seen, quantile = (
        result.seen[block],
        float(np.max(result.half[block][result.seen[block]] / result.errors[block][result.seen[block]])),
    )
    moment = np.where(seen[1:], moment, 0.0)
    covariance = slopes @ result.covariance[block, block] @ slopes.T
    return IdentifiedBody(name, mass, described + moment / mass, covariance, seen, quantile)


def tables(bodies: Bodies, sigmas: float) -> dict[str, Mapping[str, Any]]:
    """Tables of a task file: what was identified, and `[tolerance]`."""
    table: dict[str, Any] = {body.name: body.to_table() for body in bodies.bodies}
    limits: dict[str, Any] = {}
    for body in bodies.bodies:
        limits |= body.tolerance(sigmas)
    return {**table, "tolerance": limits}
