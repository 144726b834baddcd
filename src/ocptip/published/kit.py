"""Arms of the modular kit that were never built, by their axis sequence (6.1.3).

A sequence has four connections: of modules 1 and 2, 2 and 3 (both 90 mm), 3 and 4 (90 and 70 mm), 4 and the
wrist. Each is frontal (F), sideways (S), parallel (P1, P2) or skew (W1, W2). All that hangs on a connection
belongs to one link, and is known from the arms that were built. Two more follow from these without new parts:
W1 and W2 are mirror images, and P1 is P2 with the next module turned upside down on the same adapter. S needs
a preceding F, for which there are oblique adapters (figure 6.10). Zero angles of joints are those of the
links as they were built.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError

_CODE = re.compile(r"F|S|P1|P2|W1|W2")
_PLACES = ("modules 1 and 2", "modules 2 and 3", "modules 3 and 4", "module 4 and the wrist")
_ROWS = ("r_QQ", "r_QM_own", "r_QM_next_from_Qk", "r_QA", "r_QK2", "r_QK1")
_REST = ("m_A_g", "m_K2_g", "m_K1_g", "theta_M2_gmm2", "theta_M1_gmm2")
_OTHER = {"W1": "W2", "W2": "W1", "P1": "P2", "P2": "P1"}
_WORDS = {"S'": "S after F", "F'": "F before S"}
_MIRROR, _TURN = np.diag([-1.0, 1.0, 1.0]), np.diag([1.0, -1.0, -1.0])
_HALF = (45.2, 45.2, 45.2, 35.2)  # mm: Q to the middle of a half of modules 1 to 4
_COVER, _ADAPTER, _CABLE, _WRIST = (77.0, 77.0, 77.0, 60.0), 50.0, 15.0, 60.0  # mm, radii


def codes(name: str) -> tuple[str, ...]:
    """The four connections of a sequence, () where `name` is none."""
    found = tuple(_CODE.findall(name))
    return found if "".join(found) == name and len(found) == 4 else ()


def described(name: str, arms: dict[str, Any]) -> dict[str, Any]:
    """The entry that an arm would have in `data/arms.json`, composed of the entries of the arms that were
    built.

    Args:
        name: axis sequence.
        arms: those that were built, by name.

    Raises:
        InputError: a connection for which the kit has no adapter; the message says where, and which it has.
    """
    sequence = codes(name)
    forms, links = _forms(sequence), []
    for place, form in enumerate(forms):
        known = _known(place, arms)
        if form not in known or (form == "S'" and sequence[place - 1 : place] != ("F",)):
            there = ", ".join(sorted(_WORDS.get(one, one) for one in known))
            raise InputError(
                f"arm: {name}: the kit has no adapter for {sequence[place]} between {_PLACES[place]}; "
                f"there are {there}"
            )
        links.append(known[form])
    if (forms[2][0] == "W") != (forms[3] == "F"):
        raise InputError(
            f"arm: {name}: module 4 would have to be turned round; before the wrist, F goes with W1 or W2 "
            "between modules 3 and 4, all others with P1, P2 or F"
        )
    whole = arms["FP1W2F"]
    links += [_link(whole, 4), _link(whole, 5)]
    out: dict[str, Any] = {key: [link[key] for link in links] for key in (*_ROWS, *_REST)}
    out["A0"] = [whole["A0"][0], *(link["A0"] for link in links[:5])]
    return out | {
        "phi_max_exceptions_deg": {},
        "spheres": _spheres(out) | {"5": whole["spheres"]["5"]},
        "refined_r_QQ": {},
    }


def _forms(sequence: tuple[str, ...]) -> list[str]:
    """Connections, with a prime where they are oblique."""
    following = (*sequence[1:], "")
    return [
        code + "'" * (code == "S" or (code == "F" and after == "S"))
        for code, after in zip(sequence, following, strict=True)
    ]


def _known(place: int, arms: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Links that connect modules at this place, 0 to 3, by form."""
    found: dict[str, dict[str, Any]] = {}
    for own in (place, *({0, 1} - {place} if place < 2 else ())):
        for name, arm in arms.items():
            found.setdefault(_forms(codes(name))[own], _link(arm, own))
    for form, link in list(found.items()):
        if form in _OTHER:
            found.setdefault(_OTHER[form], _mirrored(link) if form[0] == "W" else _turned(link))
    return found


def _link(arm: dict[str, Any], i: int) -> dict[str, Any]:
    link = {key: arm[key][i] for key in (*_ROWS, *_REST)}
    return link | {"A0": arm["A0"][min(i + 1, 5)]}


def _mirrored(link: dict[str, Any]) -> dict[str, Any]:
    """The mirror image of a link, x to -x; its modules are symmetric to that plane."""
    rows = {key: (_MIRROR @ np.array(link[key], dtype=float)).tolist() for key in _ROWS}
    rows |= {key: (_MIRROR @ np.array(link[key]) @ _MIRROR).tolist() for key in _REST if "theta" in key}
    return link | rows | {"A0": (_MIRROR @ np.array(link["A0"]) @ _MIRROR).tolist()}


def _turned(link: dict[str, Any]) -> dict[str, Any]:
    """A link of parallel axes whose next module is upside down, fastened in the same place."""
    x, y, z = link["r_QQ"]
    a, b, c = link["r_QM_next_from_Qk"]
    turned = {"r_QQ": [x, y, 2 * _HALF[0] - z], "r_QM_next_from_Qk": [a, b, -c]}
    return link | turned | {"A0": (np.array(link["A0"]) @ _TURN).tolist()}


def _spheres(rows: dict[str, Any]) -> dict[str, Any]:
    """Spheres that cover modules, adapters and cables of links 1 to 4, as those of (B.25) do."""
    found: dict[str, Any] = {"B": {"centres_from_Q1_mm": [[0, 0, -_HALF[0]]], "R_mm": [_COVER[0]]}}
    for i in range(4):
        to_next, axis = np.array(rows["r_QQ"][i], dtype=float), np.array(rows["A0"][i + 1])[:, 2]
        parts = [((0.0, 0.0, _HALF[i]), _COVER[i]), (rows["r_QA"][i], _ADAPTER)]
        if i < 3:
            parts.append((to_next - _HALF[i + 1] * axis, _COVER[i + 1]))
        else:
            parts.append((to_next + rows["r_QM_next_from_Qk"][i], _WRIST))
        cables = ((rows[f"r_QK{k}"][i], rows[f"m_K{k}_g"][i]) for k in (1, 2))
        parts += [(point, _CABLE) for point, mass in cables if mass]
        found[str(i + 1)] = {
            "link": i + 1,
            "centres_from_Q_mm": [list(map(float, point)) for point, _ in parts],
            "R_mm": [radius for _, radius in parts],
        }
    return found
