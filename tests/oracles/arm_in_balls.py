"""An arm's torques and base wrench in ball arithmetic (python-flint), in base axes."""

from flint import arb, ctx

ctx.prec = 300


def dot(a, b):
    return sum((x * y for x, y in zip(a, b, strict=True)), arb(0))


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def plus(*vectors):
    return [sum(parts, arb(0)) for parts in zip(*vectors, strict=True)]


def times(k, v):
    return [k * x for x in v]


def apply(R, v):
    return [dot(row, v) for row in R]


def product(A, B):
    return [[dot(row, column) for column in zip(*B, strict=True)] for row in A]


def numbers(array):
    return [numbers(row) for row in array] if hasattr(array, "__len__") else arb(float(array))


def polynomial(c, u):
    value = arb(0)
    for x in reversed(c):
        value = value * u + arb(float(x))
    return value


def loads(data, q, qd, qdd, gravity, about):
    """Torques and wrench (lists of arb) at coordinates, speeds, accelerations (lists of arb)."""
    m = {key: numbers(value) for key, value in data.items()}
    rows = range(len(data["masses"]))
    value = [dot(m["ratios"][i], q) + m["shift"][i] for i in rows]
    rate = [dot(m["ratios"][i], qd) for i in rows]
    change = [dot(m["ratios"][i], qdd) for i in rows]
    zero = [arb(0)] * 3
    R, p, omega, alpha, a = (
        m["mount_rotation"],
        m["mount_position"],
        zero,
        zero,
        times(arb(-1), numbers(gravity)),
    )
    axes, origins, forces, moments, centres = [], [], [], [], []
    for i in rows:
        before, R = R, product(R, m["rotations"][i])
        z = [row[2] for row in R]
        way = times(value[i], z) if data["slides"][i] else zero
        if i:
            way = plus(way, apply(before, m["offsets"][i - 1]))
        a = plus(a, cross(alpha, way), cross(omega, cross(omega, way)))
        p = plus(p, way)
        if data["slides"][i]:
            a = plus(a, times(2 * rate[i], cross(omega, z)), times(change[i], z))
        else:
            c, s = value[i].cos(), value[i].sin()
            R = product(R, [[c, -s, arb(0)], [s, c, arb(0)], [arb(0), arb(0), arb(1)]])
            alpha = plus(alpha, times(rate[i], cross(omega, z)), times(change[i], z))
            omega = plus(omega, times(rate[i], z))
        arm = apply(R, m["centres"][i])
        f = times(m["masses"][i], plus(a, cross(alpha, arm), cross(omega, cross(omega, arm))))
        inertia = product(product(R, m["inertias"][i]), list(zip(*R, strict=True)))
        moments.append(plus(apply(inertia, alpha), cross(omega, apply(inertia, omega))))
        forces.append(f)
        centres.append(plus(p, arm))
        axes.append(z)
        origins.append(p)
    held, given = (m.get(key, [arb(0)] * 6) for key in ("process_on_link", "process_in_base"))
    push, twist = (plus(apply(R, held[k : k + 3]), given[k : k + 3]) for k in (0, 3))
    tip = plus(p, apply(R, m["offsets"][-1]))
    needed = []
    for i in rows:
        to_tip = plus(tip, times(arb(-1), origins[i]))
        of_process = push if data["slides"][i] else plus(twist, cross(to_tip, push))
        total = -dot(axes[i], of_process)
        for k in rows[i:]:
            if data["slides"][i]:
                total += dot(axes[i], forces[k])
            else:
                lever = plus(centres[k], times(arb(-1), origins[i]))
                total += dot(axes[i], plus(moments[k], cross(lever, forces[k])))
        needed.append(total)
    columns = list(zip(*m["ratios"], strict=True))
    torques = [
        dot(column, needed) + armature * x
        for column, armature, x in zip(columns, m["armature"], qdd, strict=True)
    ]
    none = [0.0] * len(torques)
    springs = zip(q, data.get("spring_torque", none), data.get("spring_stiffness", none), strict=True)
    torques = [
        x - (arb(float(at_zero)) - arb(float(stiffness)) * y)
        for x, (y, at_zero, stiffness) in zip(torques, springs, strict=True)
    ]
    force = plus(push, times(arb(-1), plus(*forces)))
    levers = [plus(c, times(arb(-1), numbers(about))) for c in centres]
    moment = times(arb(-1), plus(*moments, *(cross(r, f) for r, f in zip(levers, forces, strict=True))))
    moment = plus(moment, twist, cross(plus(tip, times(arb(-1), numbers(about))), push))
    return torques, [*force, *moment]
