"""Are the claims of a certificate true at instants and in worlds drawn at random? By nothing of the checker.

Wrenches come from `world_in_balls`, contact forces from a linear program with cones that are a little too
large, moments about tipping axes from the normal forces of three feet. So what is said to be false is false.
"""

from itertools import product

import numpy as np
from scipy.optimize import linprog

from tests.oracles import world_in_balls as worlds

_SIDES = 24
_LOOSE = 1e-7  # relative: roundings of the program


def falsehood(data, rng, samples):
    """What is not so at one of some instants, each in the world as described and in one of the tolerance."""
    model, motion, bounds, tolerance = (data[key] for key in ("model", "motion", "bounds", "tolerance"))
    times = np.array(motion["times"], dtype=float) + 0.0  # no negative zeros
    for _ in range(samples):
        piece = int(rng.integers(len(times)))
        t = float(rng.choice([*times[piece], rng.uniform(*times[piece])]))
        c = np.array(motion["angles"], dtype=float)
        state = np.column_stack([worlds.at(times, c, piece, t, j) for j in range(c.shape[1])])
        acting = _acting(model, t)
        torques, wrench = _numbers(worlds.loads(acting, worlds.described(model), state))
        if found := (
            _limits(model, bounds, torques, state)
            or _contacts(model, wrench, bounds["GN"], bounds["GT"], 1.0)
            or _gaps(model, bounds["clearance"], state[0], rng)
            or _fast(model, bounds.get("point_speed_ratio"), state)
        ):
            return f"{found} at {t}"
        if tolerance is not None:
            late = float(rng.uniform(0.0, times[-1, 1] + tolerance["delay"]))
            world = worlds.random_world(model, tolerance, rng, ends=0.8)
            joints = worlds.LateJoints(motion, tolerance)
            state = joints.state(joints.draw(late, rng))
            wrench = _numbers(worlds.loads(_acting(model, late), world, state))[1]
            asked, weak = (bounds[f"{key}_worst_case"] for key in ("GN", "GT")), 1 - tolerance["friction"]
            if found := _contacts(model, wrench, *asked, weak):
                return f"{found} within the tolerance at {late}"
            asked = bounds.get("clearance_worst_case")
            if asked is not None and (found := _gaps(model, asked, state[0], rng)):
                return f"{found} with late joints at {late}"
            if "decelerations_on_cancel" in model:
                (_, t, _, _), stopped = _cancelled(data, joints, rng)
                wrench = _numbers(worlds.loads(_acting(model, t), world, stopped))[1]
                asked = (bounds[f"{key}_cancel_worst_case"] for key in ("GN", "GT"))
                if found := _contacts(model, wrench, *asked, weak):
                    return f"{found} when cancelled at {t}"
                if _outside(model, bounds["angle_margin_cancel"], stopped[0]):
                    return f"angle when cancelled at {t}"
            state[1] *= world.pace
            if found := _fast(model, bounds.get("point_speed_ratio_worst_case"), state):
                return f"{found} with late joints at {late}"
    return None


def _acting(model, t):
    """The model with what acts on the gripper at a time."""
    arm = model["arm"]
    if "process_times" not in arm:
        return model
    own = {
        key: [float(np.interp(t, arm["process_times"], column)) for column in np.transpose(arm[key])]
        for key in ("process_in_base", "process_on_link")
    }
    return {**model, "arm": arm | own}


def _numbers(loads):
    return tuple(np.array([float(x.mid()) for x in part]) for part in loads)


def _limits(model, bounds, torques, state):
    limits = model["limits"]
    for name, values, slack in (
        ("torque", torques / bounds["torque_ratio"], 1e-9),
        ("speed", state[1], 2e-5),
        ("acceleration", state[2], 2e-5),
    ):
        most = np.array([np.inf if x is None else x for x in limits[name]], dtype=float)
        if np.any(np.abs(values) > most * (1 + slack)):
            return name
    low, high = (
        np.array([none if x is None else x for x in limits[key]], dtype=float)
        for key, none in (("angle_min", -np.inf), ("angle_max", np.inf))
    )
    return "angle" if np.any(state[0] < low - 2e-7) or np.any(state[0] > high + 2e-7) else None


def _contacts(model, wrench, most, share, friction):
    """Whether no forces hold the base, or less than claimed is left about a tipping axis."""
    base, contacts = model["base"], model["contacts"]
    places = np.array(contacts["positions"]) - np.array(base["center_of_mass"])
    frames = np.array(contacts["frames"], dtype=float)
    levers = [np.cross(p, f.T).T for p, f in zip(places, frames, strict=True)]
    grasp = np.vstack([np.hstack(list(frames)), np.hstack(levers)])
    angles = 2 * np.pi * np.arange(_SIDES) / _SIDES
    size = np.max(np.abs(wrench)) + 1.0
    for pieces in product(*contacts["sets"]):
        rows, ends = [], []
        for k, (_, _, radius, slope) in enumerate(pieces):
            for a in angles:  # a polygon round the cone
                row = np.zeros(grasp.shape[1])
                row[3 * k : 3 * k + 3] = -share * friction * slope, np.cos(a), np.sin(a)
                rows.append(row)
                ends.append(share * friction * radius + _LOOSE * size)
        normal = [(low, high) for low, high, *_ in pieces]
        spans = [span for own in normal for span in (own, (None, None), (None, None))]
        found = linprog(np.zeros(grasp.shape[1]), np.array(rows), ends, grasp, -wrench, spans, method="highs")
        if found.status == 0:
            break
    else:
        return "contacts"
    normals = frames[:, :, 0]
    system = grasp[2:5, ::3]  # normal forces of three feet on a floor
    forces = np.linalg.solve(system, -wrench[2:5])
    needed = base["reference_moment"] * (1 / most - 1)
    for k in range(3):
        i, j = (x for x in range(3) if x != k)
        e = places[j] - places[i]
        lift = abs(normals[k] @ np.cross(e / np.linalg.norm(e), places[k] - places[i]))
        least = min(piece[0] if piece[0] is not None else -np.inf for piece in contacts["sets"][k])
        if lift * (forces[k] - least) < needed - _LOOSE * size:
            return "tipping"
    return None


def _gaps(model, asked, q, rng):
    """Whether two points of two bodies, of many tried, come closer than claimed."""
    bodies = model["bodies"]
    for first, second in model["pairs"]:
        one = _points(model, bodies[first], q, rng)
        if "normal" in bodies[second]:
            other = bodies[second]
            gap = other["level"] - np.max(one @ np.array(other["normal"])) - bodies[first]["radius"]
        else:
            two = _points(model, bodies[second], q, rng)
            gap = np.min(np.linalg.norm(one[:, None] - two[None], axis=2))
            gap -= bodies[first]["radius"] + bodies[second]["radius"]
        if gap < asked - 1e-9:
            return f"clearance {gap}"
    return None


def _cancelled(data, joints, rng):
    """Where a motion is cancelled (piece, s), how long after that it is, s, and when joints are there, (n,),
    s; and coordinates, speeds and accelerations (3, n).

    Every joint is at a time of its own, by up to the delay earlier: in the motion, decelerating or at rest;
    or just after a step of its acceleration, with overshoot of that and of steps less than the delay before.
    """
    rates = np.array(data["model"]["decelerations_on_cancel"], dtype=float)
    pieces = np.flatnonzero(np.diff(joints.times, axis=1)[:, 0] > 0)
    piece = int(rng.choice(pieces))
    t = float(rng.choice([*joints.times[piece], rng.uniform(*joints.times[piece])]))
    begun = np.array([joints._at(piece, t, j) for j in range(joints.n)]).T
    rests = np.abs(begun[1]) / rates * (np.abs(begun[1]) > 1e-6)
    longest = joints.delay + np.max(rests) * (rng.random() < 0.7)  # else joints may be in the motion
    after, state, whens = rng.uniform(0.0, longest), np.empty((3, joints.n)), np.empty(joints.n)
    for j, (q, v, acting) in enumerate(begun.T):
        slower = -np.sign(v) * rates[j] * (rests[j] > 0)
        low = after - joints.delay
        earlier = [k for k, e in enumerate(joints.events[:piece]) if e >= t + low and joints.jumps[k, j]]
        steps = [(float(joints.events[k]) - t, joints.steps[k, j]) for k in earlier]
        steps += [(when, step) for when, step in ((0.0, slower - acting), (rests[j], -slower)) if when >= low]
        steps = [(when, step) for when, step in steps if when <= after]
        if steps and rng.random() < 0.5:
            last = int(rng.integers(len(steps)))
            first = int(rng.integers(last + 1))
            when, exceeded = steps[last][0], joints.more * sum(step for _, step in steps[first : last + 1])
            exceeded *= int(rng.integers(2))
            whens[j] = when
            if last < len(earlier):
                state[:, j] = joints._at(earlier[last] + 1, t + when, j)
                state[2, j] += exceeded
                continue
            more = (slower if when == 0.0 and rests[j] > 0 else 0.0) + exceeded
        else:
            when, more = after - rng.uniform(0, joints.delay), None
        whens[j] = when
        if when < 0:
            earlier = int(np.clip(np.searchsorted(joints.events, t + when), 0, piece))
            state[:, j] = joints._at(earlier, max(t + when, 0.0), j)
            continue
        own = min(when, rests[j])
        state[:, j] = q + v * own + slower * own**2 / 2, v + slower * own, slower * (when < rests[j])
        state[2, j] = state[2, j] if more is None else more
    return (piece, t, after, whens), state


def _outside(model, margin, q):
    low, high = (
        np.array([none if x is None else x for x in model["limits"][key]], dtype=float)
        for key, none in (("angle_min", -np.inf), ("angle_max", np.inf))
    )
    return np.any(q < low + margin - 1e-9) or np.any(q > high - margin + 1e-9)


def _fast(model, asked, state):
    """Whether a point of the last link is faster than claimed, by differences of its place."""
    if asked is None:
        return None
    step = 1e-4
    for point in model["points"]:
        assert point["link"] == len(model["arm"]["masses"])
        arm = {**model["arm"], "offsets": [*model["arm"]["offsets"][:-1], point["place"]]}
        ahead, behind = (
            worlds.tool({**model, "arm": arm}, state[0] + x * state[1], np.zeros(3)) for x in (step, -step)
        )
        speed = np.linalg.norm([float((a - b).mid()) for a, b in zip(ahead, behind, strict=True)]) / step / 2
        if speed > asked * point["speed"] * (1 + 1e-5) + 1e-9:
            return f"speed {speed}"
    return None


def _points(model, body, q, rng):
    """Some points (k, 3) of a body, base axes: of a link by the place that a unit mass at the TCP has."""
    points = np.array(body["points"], dtype=float)
    if len(points) > 1:
        shares = rng.dirichlet(np.ones(len(points)), 20)
        points = np.vstack([points, shares @ points])
    if body["link"] < 0:
        return points
    if body["link"] == 0:
        arm = model["arm"]
        return points @ np.array(arm["mount_rotation"]).T + np.array(arm["mount_position"])
    found = []
    for point in points:
        arm = {**model["arm"], "offsets": [*model["arm"]["offsets"][:-1], point.tolist()]}
        assert body["link"] == len(arm["masses"])
        found.append([float(x.mid()) for x in worlds.tool({**model, "arm": arm}, q, np.zeros(3))])
    return np.array(found)
