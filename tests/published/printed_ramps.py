"""Joint angles at start and goal that tables E.1 and E.2 imply, from the rules of thesis M, 5.2, alone."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

TABLES = json.loads((Path(__file__).parent / "data" / "reference_solutions.json").read_text(encoding="utf-8"))
COLUMNS = {"FP1W2F": "ABC", "FSFS": "DEF", "W1P1P2W2": "GH"}


def ramp(
    t: float, angle: float, speed: float, target: float, v: float, a: float
) -> tuple[list[float], float, float]:
    """Times (t', t'', t_e) of one profile command and state (angle, speed) at t''; degrees and seconds."""
    way = target - angle
    forth = 0.5 * (speed + v) * abs(v - speed) / a + 0.5 * v**2 / a
    back = 0.5 * (speed - v) * abs(v + speed) / a - 0.5 * v**2 / a
    if way >= forth:
        peak, cruise = v, (way - forth) / v
    elif way <= back:
        peak, cruise = -v, (back - way) / v
    else:
        u = np.sign(-way + speed * abs(speed) / (2 * a))
        peak, cruise = -u * np.sqrt(speed**2 / 2 - u * a * way), 0.0
    t1 = t + abs(peak - speed) / a
    t2 = t1 + cruise
    braking = abs(peak) / a
    return [t1, t2, t2 + braking], target - 0.5 * peak * braking, peak


def times(column: str, joint: int, start: float, goal: float) -> np.ndarray:
    """(7,) s: t_1', t_1'', t_2', t_2'', t_3', t_3'', t_E of one joint (1..3)."""
    p = dict(zip(TABLES["parameter_names"], TABLES["E1"][column], strict=True))
    for name, fix in TABLES["E1_misprints"].get(column, {}).items():
        p[name] = fix["correct"]
    result: list[float] = []
    t, angle, speed = 0.0, start, 0.0
    for number in (1, 2, 3):
        target = p.get(f"phi_e_{joint}_{number}", goal)
        events, angle, speed = ramp(
            t, angle, speed, target, p[f"phidot_{joint}_{number}"], p[f"phiddot_{joint}_{number}"]
        )
        result += events[:2]
        t = events[1]
    return np.array([*result, events[2]])


def printed_times(column: str, joint: int) -> np.ndarray:
    """The same seven times as printed in table E.2."""
    names = [f"t{joint}_{r}{mark}" for r in (1, 2, 3) for mark in ("p", "pp")] + [f"t{joint}_E"]
    return np.array([TABLES["E2"][column][name] for name in names])


def implied_angles(arm: str, joint: int, near: tuple[float, float]) -> np.ndarray:
    """(start, goal) in degrees that reproduce the printed times best, searched from `near`."""

    def residual(x: np.ndarray) -> np.ndarray:
        return np.concatenate([times(c, joint, *x) - printed_times(c, joint) for c in COLUMNS[arm]]) / 3e-5

    return least_squares(residual, near, x_scale=0.01, diff_step=1e-7).x
