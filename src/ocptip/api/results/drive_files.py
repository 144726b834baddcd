"""Files of a drive envelope: limits as plain data and as a table, parameters of Nav2's velocity smoother."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from ocptip.standing.at_rest.drive_envelope import LargestManoeuvres
from ocptip.standing.at_rest.manoeuvres import Manoeuvre

_COLUMNS = "largest", "tips_at", "slips_at", "slips_if_shared_ideally_at", "first_contact_lifts_at"


def manoeuvre_limits(result: LargestManoeuvres, k: int, one: Manoeuvre) -> dict[str, Any]:
    """Largest value of manoeuvre k and what limits it, as plain data."""
    known, slips = bool(np.isfinite(result.lift[k])), result.slip[k] < result.tip[k]
    friction = min(float(result.slip[k]), float(result.alike[k]))
    return {
        **({} if result.times is None else {"time_s": float(result.times[k])}),
        "largest": one.value(float(result.largest[k])),
        "tips_at": one.value(float(result.tip[k])),
        "first_contact_lifts_at": one.value(float(result.lift[k])) if known else None,
        "slips_at": one.value(friction) if friction < result.tip[k] else None,
        "slips_if_shared_ideally_at": one.value(float(result.slip[k])) if slips else None,
        "tips_about_contacts": result.contacts[k].tolist() if result.contacts[k].any() else None,
    }


def limits_csv(limits: Mapping[str, dict[str, Any]], cases: Sequence[str]) -> str:
    """Directions and manoeuvres of the base, then of each object, as a table; empty: without a limit.

    Args:
        limits: `DriveEnvelope.limits` of the base, named "", and of each object.
        cases: "nominal", and "within" where there is an uncertainty.
    """
    stream, of_object = io.StringIO(), ["object"] if len(limits) > 1 else []
    rows = csv.writer(stream, lineterminator="\n")
    values = [(case, name) for case in cases for name in _COLUMNS]
    rows.writerow(["manoeuvre", "direction_deg", "unit", *map("_".join, values), *of_object])
    for name, table in limits.items():
        around = [("direction", one) for one in table["directions"]]
        for key, one in (*around, *table["manoeuvres"].items()):
            about = key, one.get("direction_deg"), one["unit"]
            rows.writerow([*about, *(one[case][value] for case, value in values), *[name for _ in of_object]])
    return stream.getvalue()


def smoother_yaml(remarks: Iterable[str], navigation: Mapping[str, Sequence[float]]) -> str:
    """Parameters of Nav2's velocity smoother, after remarks; empty ones are left out."""
    lines = [*(f"# {text}" for text in remarks if text), "velocity_smoother:", "  ros__parameters:"]
    for name, values in navigation.items():
        # Rounded towards zero: the numbers must stay inside the envelope.
        shown = ", ".join(f"{np.trunc(1e3 * value) / 1e3 + 0.0:.3f}" for value in values)
        lines.append(f"    {name}: [{shown}]")
    return "\n".join([*lines, ""])
