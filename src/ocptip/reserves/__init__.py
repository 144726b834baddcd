"""Margins of contact states: tip-over index GN and friction utilisation GT, with exact derivatives.

A base on contacts with a unique state maintains them if and only if GN < 1 and GT < 1, up to the error of the
friction pyramid. Neither index sees one kind of motion: a rotation about two loaded contacts in which others,
unloaded, move only along their tangent planes (possible with normals in different directions).
`ContactStates.persistent` sees every motion.

Thesis M, whose equation numbers are cited, is described in docs/bibliography.md.
"""

from ocptip.reserves.slip import Slip
from ocptip.reserves.tipping import TipOver

__all__ = [
    "Slip",
    "TipOver",
]
