"""S-curves of one joint: velocity profiles whose accelerations take a time to rise and fall (are trapezoids).

The angle is the mean of that of the trapezoidal velocity profile over the last `rise_time` tau seconds, and
so are speed and acceleration. After an acceleration step of the profile at t, the acceleration of the S-curve
changes linearly until t + tau: all phases are cubics, and every switching time becomes two. Targets stay;
speeds and accelerations stay within those of the profile. The jerk stays within the maximum change of the
acceleration over tau, at most 2 a / tau. The motion takes tau longer. Drives produce this with a moving
average of their set points.
"""

from __future__ import annotations

import numpy as np

from ocptip.basics.errors import positive_number
from ocptip.trajectories.pieces import Pieces
from ocptip.trajectories.ramps import JointRamps


def s_curve(ramps: JointRamps, rise_time: float) -> Pieces:
    """Return the cubics of one joint whose profile has accelerations that take `rise_time` (s) to change.

    Raises:
        InputError: the rise time is not > 0.
    """
    tau, edges, goal = positive_number("rise_time", rise_time), ramps.times, ramps.angles[-1:]
    if ramps.end == 0:
        return Pieces(edges[:1], np.empty((4, 0, 1)), goal)
    t = np.unique(np.concatenate([edges, edges + tau]))
    edge_times, middles = np.stack([t, t - tau]), 0.5 * (t[1:] + t[:-1])
    angles, speeds, _ = ramps.states(edge_times)
    accelerations = ramps.pieces.at(np.stack([middles, middles - tau]), range(2, 3))[0][..., 0]
    phi = -np.diff(_integral(ramps, edge_times), axis=0)[0] / tau
    w, a, jerks = ((now - before) / tau for now, before in (angles, speeds, accelerations))
    phi[0], w[0], a[0] = ramps.phi_start, 0.0, 0.0
    return Pieces(t, np.stack([phi[:-1], w[:-1], a[:-1], jerks])[..., None], goal)


def _integral(ramps: JointRamps, times: np.ndarray) -> np.ndarray:
    """Integral of the angle from t = 0 to each time, rad s; the joint rests before and after."""
    lengths, angles, speeds = ramps.durations, ramps.angles[:-1], ramps.speeds[:-1]
    pieces = lengths * (angles + lengths * (speeds / 2 + lengths * ramps.accelerations / 6))
    at_edges = np.concatenate([[0.0], np.cumsum(pieces)])
    piece = np.clip(np.searchsorted(ramps.times, times, side="right") - 1, 0, len(lengths) - 1)
    t = np.clip(times, 0, ramps.end) - ramps.times[piece]
    inside = angles[piece] + t * (speeds[piece] / 2 + t * ramps.accelerations[piece] / 6)
    rest = np.minimum(times, 0) * ramps.phi_start + np.maximum(times - ramps.end, 0) * ramps.phi_end
    return at_edges[piece] + t * inside + rest
