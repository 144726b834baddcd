"""Importing this lets Python look for cyclic garbage rarely: for a process of ocptip's own.

Imports, programs and figures make objects by the million, and few cycles; looking for them took a fifth of
the time of imports and up to half of that of a figure. In the end the process goes with all it has: looking
once more took 0.15 s.
"""

from __future__ import annotations

import atexit
import gc

gc.set_threshold(500_000)  # more objects than are loaded
atexit.register(gc.freeze)


def loaded() -> None:
    """To be called when most is loaded: nothing of that is looked at again, and garbage is, now and then."""
    gc.freeze()
    gc.set_threshold(50_000)
